"""The finest detail: relief that is no paint in the normals, the photo's in the albedo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import tiny_run
from unlit.optimize.fine_albedo import fine_albedo
from unlit.optimize.problem import Problem
from unlit.optimize.relief import fine_part, pixel_frames, with_relief
from unlit.settings.detail import FineDetail

#: The tiny crop has 32 pixels, where lengths are for 512.
SETTINGS = FineDetail(relief=2.0, relief_length=40.0, albedo_length=64.0)
LIT = 0.8


def problem_of(image: np.ndarray | None = None) -> Problem:
    regions = np.zeros((tiny_run.SIZE, tiny_run.SIZE, 5), np.float32)
    regions[..., 0] = 1
    plain = np.full((tiny_run.SIZE, tiny_run.SIZE, 3), (0.5, 0.35, 0.3), np.float32)
    return tiny_run.problem(regions=regions, image=plain if image is None else image)


def bumps(problem: Problem) -> np.ndarray:
    """The perturbation (P, 3) of a fine relief."""
    shape = problem.inside.shape
    noise = np.random.default_rng(0).standard_normal(shape)
    height = ndimage.gaussian_filter(noise, 1.2).ravel()[problem.pixel]
    return pixel_frames(problem).perturbation_of(0.2 * height)


def strength(problem: Problem, found: np.ndarray, true: np.ndarray) -> float:
    """How much of `true` is in `found`, both (P, 3), where the surface is seen well."""
    seen = pixel_frames(problem).facing > 0.5
    a, b = found[seen].ravel(), true[seen].ravel()
    return float(a @ b / (b @ b))


def test_a_relief_is_scaled_and_the_rest_is_kept() -> None:
    problem = problem_of()
    e = bumps(problem)
    fine = fine_part(problem, e, SETTINGS)
    lit = np.full(len(problem), LIT)
    found = with_relief(problem, e, lit, SETTINGS)
    assert strength(problem, fine_part(problem, found, SETTINGS), fine) == pytest.approx(2, rel=0.3)
    np.testing.assert_array_equal(with_relief(problem, e, lit, replace(SETTINGS, relief=1.0)), e)


def test_what_is_no_relief_goes() -> None:
    """Each normal by itself, in the dark, or where hair grows."""
    problem = problem_of()
    lit = np.full(len(problem), LIT)
    noise = np.random.default_rng(1).standard_normal((len(problem), 3)).astype(np.float32) * 0.05
    noise -= (noise * problem.points().specular_normal.numpy().T).sum(axis=1, keepdims=True)
    kept = with_relief(problem, noise, lit, SETTINGS)
    assert strength(problem, kept, noise) < 0.75 * SETTINGS.relief
    dark = with_relief(problem, bumps(problem), 0 * lit, SETTINGS)
    assert np.abs(fine_part(problem, dark, SETTINGS)).max() < 0.5 * np.abs(bumps(problem)).max()
    hairy = tiny_run.problem(regions=np.full((tiny_run.SIZE, tiny_run.SIZE, 5), 0.2, np.float32))
    bare = with_relief(hairy, bumps(hairy), lit, SETTINGS)
    np.testing.assert_allclose(bare, bumps(hairy) - fine_part(hairy, bumps(hairy), SETTINGS))


def test_the_edges_of_a_pigment_are_no_relief() -> None:
    """A spot redder than the skin; a grey one, as of a shadow in a pore, stays."""
    size = tiny_run.SIZE
    kept = {}
    for name, spot in (("grey", (0.7, 0.7, 0.7)), ("brown", (0.8, 0.6, 0.5))):
        rng = np.random.default_rng(2)
        image = np.full((size, size, 3), (0.5, 0.35, 0.3)) * rng.uniform(
            0.99, 1.01, (size, size, 3)
        )
        image[12:18, 12:18] *= spot
        problem = problem_of(image.astype(np.float32))
        e = bumps(problem)
        found = with_relief(problem, e, np.full(len(problem), LIT), SETTINGS)
        at = np.zeros((size, size), dtype=bool)
        at[13:17, 13:17] = True
        rows = at.ravel()[problem.pixel]
        kept[name] = np.linalg.norm(fine_part(problem, found, SETTINGS)[rows])
    assert kept["brown"] < 0.5 * kept["grey"]


def test_fine_albedo_is_the_photo_over_the_shading() -> None:
    """Freckles come back, a coarse error of the shading and what lies in the dark do not."""
    size = tiny_run.SIZE
    true = np.full((size, size, 3), (0.5, 0.35, 0.3), np.float32)
    true[::4, ::4] *= 0.9
    shading = np.linspace(0.3, 1.0, size, dtype=np.float32)[:, None, None] * np.ones((1, size, 1))
    problem = problem_of((true * shading).astype(np.float32))

    def rows(image: np.ndarray) -> np.ndarray:
        return image.reshape(-1, image.shape[-1])[problem.pixel]

    smooth = np.full((len(problem), 3), (0.5, 0.35, 0.3), np.float32)
    wrong = rows(np.repeat(shading, 3, axis=2)) * 0.9
    none = np.zeros_like(smooth)
    found = fine_albedo(problem, smooth, none, wrong, SETTINGS)
    contrast = np.log(found / smooth).mean(axis=1)
    spots = rows(true)[:, 0] < 0.48
    sure = rows(problem.observation.weight[..., None])[:, 0] > 0.99
    found_contrast = contrast[sure & spots].mean() - contrast[sure & ~spots].mean()
    assert found_contrast == pytest.approx(np.log(0.9), rel=0.1)
    assert abs(contrast.mean()) < 0.03  # not ln(1 / 0.9): the level stays
    dark = fine_albedo(problem, smooth, none, 0.05 * wrong, SETTINGS)
    np.testing.assert_array_equal(dark, smooth)
