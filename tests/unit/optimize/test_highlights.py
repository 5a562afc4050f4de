"""Highlights go from the diffuse to the specular albedo; pigments stay, and so does the render."""

from __future__ import annotations

import numpy as np
import pytest

import tiny_run
from unlit.optimize.highlights import body_around, with_highlights
from unlit.optimize.problem import Problem
from unlit.perception.regions import REGIONS
from unlit.settings.detail import FineDetail

#: The tiny crop has 32 pixels, where lengths are for 512.
SETTINGS = FineDetail(highlight_length=96.0)
SKIN = np.array([0.5, 0.3, 0.2])
SIZE = tiny_run.SIZE
#: S where E is 1, and the gloss that is there before.
MIRRORED, GLOSS = 0.07, 1.0
HIGHLIGHT = 0.08


@pytest.fixture(scope="module")
def problem() -> Problem:
    """A face that is all skin."""
    regions = np.zeros((SIZE, SIZE, len(REGIONS)), np.float32)
    regions[..., 0] = 1
    return tiny_run.problem(regions=regions)


def spots() -> np.ndarray:
    """(32, 32) bool, some pixels of the face."""
    where = np.zeros((SIZE, SIZE), dtype=bool)
    where[3::6, 3::6] = True
    return where


def taken(
    problem: Problem, change: np.ndarray, mirrored: float = MIRRORED, elsewhere: float = 0.1
) -> tuple[np.ndarray, ...]:
    """What diffuse and specular albedo become, and were, on spots of skin changed by (3,).

    elsewhere: S beside the spots, of that on them, `mirrored`.
    """
    at = spots().ravel()[problem.pixel]
    albedo = np.where(at[:, None], SKIN + change, SKIN).astype(np.float32)
    gloss, e = np.full(len(problem), GLOSS, np.float32), np.ones((len(problem), 3), np.float32)
    s = mirrored * np.where(at[:, None], e, elsewhere * e)
    made = with_highlights(problem, albedo, gloss, e, s, SETTINGS)
    return made[0][at], made[1][at], albedo[at], gloss[at]


def test_a_highlight_goes_to_the_specular_albedo(problem: Problem) -> None:
    diffuse, specular, before, gloss = taken(problem, np.full(3, HIGHLIGHT))
    assert np.allclose(diffuse, SKIN, atol=0.03)
    assert (specular > gloss + 0.5).all()
    # The image stays: what rho_d loses, rho_s S has.
    assert np.allclose(before - diffuse, (specular - gloss)[:, None] * MIRRORED, atol=1e-6)


def test_in_soft_light_pale_skin_is_no_highlight(problem: Problem) -> None:
    """Where S is alike all over the face, most of it stays."""
    soft = taken(problem, np.full(3, HIGHLIGHT), elsewhere=1.0)
    hard = taken(problem, np.full(3, HIGHLIGHT))
    soft_taken, hard_taken = (before - diffuse for diffuse, _, before, _ in (soft, hard))
    assert (soft_taken < 0.3 * hard_taken).all()


def test_a_face_in_the_dark_has_no_highlight(problem: Problem) -> None:
    """Where no pixel is lit enough to say what is usual, nothing is taken, and all is finite."""
    albedo = np.tile(SKIN, (len(problem), 1)).astype(np.float32)
    albedo[::7] += HIGHLIGHT
    gloss, dim = np.full(len(problem), GLOSS, np.float32), np.full((len(problem), 3), 0.1)
    diffuse, specular = with_highlights(problem, albedo, gloss, dim, MIRRORED * dim, SETTINGS)
    np.testing.assert_array_equal(diffuse, albedo)
    np.testing.assert_array_equal(specular, gloss)


def test_pigments_stay_in_the_diffuse_albedo(problem: Problem) -> None:
    """Freckles, moles, paler and redder skin: no change of colour and light at once."""
    for change in (-0.5 * SKIN, 0.3 * SKIN, np.array([0.1, 0, 0]), np.array([-0.2, -0.02, 0])):
        diffuse, specular, before, gloss = taken(problem, change)
        assert np.allclose(diffuse, before, atol=0.01), change
        assert np.allclose(specular, gloss, atol=0.15), change


def test_where_nothing_is_mirrored_nothing_is_taken(problem: Problem) -> None:
    diffuse, specular, before, gloss = taken(problem, np.full(3, HIGHLIGHT), mirrored=1e-4)
    assert np.allclose(diffuse, before, atol=2e-3)
    assert (specular <= gloss + SETTINGS.highlight_most).all()


def test_the_colour_around_is_that_of_most_of_the_skin() -> None:
    rng = np.random.default_rng(0)
    image = np.tile(SKIN, (64, 64, 1)) * np.exp(0.05 * rng.standard_normal((64, 64, 1)))
    image[20:30, 20:30] += 0.3
    found = body_around(image, np.ones((64, 64)), FineDetail(highlight_length=64.0))
    assert np.allclose(found, SKIN, rtol=0.08)
    plain = image.mean(axis=(0, 1))
    assert np.abs(found - SKIN).max() < 0.5 * np.abs(plain - SKIN).max()
