"""The detail of what is dimly lit comes from the photo; errors of the shading do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from unlit.optimize.problem import Problem
from unlit.optimize.shade_detail import with_detail_of_shade
from unlit.settings.detail import FineDetail

#: The tiny crop has 32 pixels, where lengths are for 512.
SETTINGS = FineDetail(shade_length=96.0)
SKIN = np.array([0.5, 0.35, 0.3], np.float32)
DIM = 0.1
SIZE = tiny_run.SIZE
#: ln of a spot's albedo over the skin's.
SPOT = -0.5


def problem_of(image: np.ndarray, feature: int = 0) -> Problem:
    """feature: the region that all of the face is taken for."""
    regions = np.zeros((SIZE, SIZE, 5), np.float32)
    regions[..., feature] = 1
    return tiny_run.problem(regions=regions, image=image.astype(np.float32))


def spots() -> np.ndarray:
    """(32, 32) bool, single pixels."""
    where = np.zeros((SIZE, SIZE), dtype=bool)
    where[2::5, 2::5] = True
    return where


def contrast(e: float, feature: int = 0, shaded_as: float = 1.0) -> float:
    """ln of the spots over the skin in an albedo that was filled in evenly, under the light e.

    shaded_as: what the mesh makes of the light.
    """
    image = np.where(spots()[..., None], np.exp(SPOT), 1) * SKIN * e
    problem = problem_of(image, feature)
    even = np.tile(SKIN, (len(problem), 1))
    shading = np.full_like(even, e * shaded_as)
    found = with_detail_of_shade(problem, even, 0 * even, shading, SETTINGS)
    change = np.log(found / even).mean(axis=1)
    assert abs(np.median(change)) < 0.05  # the level stays, whatever the shading
    at = spots().ravel()[problem.pixel]
    return float(change[at].mean() - change[~at].mean())


def test_detail_in_the_shade_is_kept_and_the_level_too() -> None:
    error = SETTINGS.shade_error
    assert contrast(DIM) == pytest.approx(SPOT + error, abs=0.06)
    assert contrast(DIM, shaded_as=0.5) == pytest.approx(SPOT + error, abs=0.06)
    assert contrast(DIM, feature=2) == pytest.approx(SPOT, abs=0.06)  # eyes have no such error
    assert contrast(0.8) == 0


def test_near_black_there_is_only_noise() -> None:
    assert abs(contrast(DIM * 0.05)) < 0.2 * abs(contrast(DIM))


def test_an_edge_that_only_the_mesh_has_makes_no_seam() -> None:
    problem = problem_of(np.tile(SKIN * DIM, (SIZE, SIZE, 1)))
    even = np.tile(SKIN, (len(problem), 1))
    right = problem.pixel % SIZE > SIZE // 2
    shading = np.where(right[:, None], DIM, DIM / 3) * np.ones((1, 3))
    found = with_detail_of_shade(problem, even, 0 * even, shading, SETTINGS)
    np.testing.assert_allclose(found, even, rtol=0.02)


def test_what_is_small_goes_with_its_colour() -> None:
    rng = np.random.default_rng(0)
    noise = rng.uniform(-0.1, 0.1, (SIZE, SIZE, 3))
    problem = problem_of(SKIN * DIM * np.exp(noise))
    even = np.tile(SKIN, (len(problem), 1))
    shading = np.full_like(even, DIM)
    kept = with_detail_of_shade(problem, even, 0 * even, shading, SETTINGS)
    np.testing.assert_allclose(kept, even, rtol=0.05)
    all_of_it = replace(SETTINGS, shade_error=0.0)
    noisy = with_detail_of_shade(problem, even, 0 * even, shading, all_of_it)
    assert np.log(noisy / even).std() > 3 * np.log(kept / even).std()
