"""Displacements of known size are found, and a halo is told from an error everywhere."""

from __future__ import annotations

import features
import numpy as np
import pytest
from scipy import ndimage

from drawn_face import SIZE as DRAWN
from drawn_face import drawn_landmarks

SIZE = 128


def normals(shift: tuple[float, float]) -> np.ndarray:
    """Of a bumpy plane, (S, S, 3), its bumps moved by `shift` pixels, x and y."""
    rng = np.random.default_rng(3)
    height = ndimage.gaussian_filter(rng.standard_normal((SIZE, SIZE)), 3.0, mode="wrap")
    height = ndimage.shift(height / height.std(), shift[::-1], order=3, mode="grid-wrap")
    by_y, by_x = np.gradient(height)
    plane = np.stack([-by_x, by_y, np.ones_like(by_x)], axis=-1)
    return plane / np.linalg.norm(plane, axis=-1, keepdims=True)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.3, -0.7), (-2.0, 2.4)])
def test_displacement_is_the_shift(shift: tuple[float, float]) -> None:
    """To a fifth of a pixel in the median; 16 pixels at 512 are 4 here."""
    found = features.displacement(normals((0, 0)), normals(shift))[12:-12, 12:-12]
    off = np.abs(found - shift)
    assert np.median(off) < 0.2 and np.quantile(off, 0.9) < 0.5


def test_distances_are_stated_at_512() -> None:
    """A shift across the edges of half a pixel of 128 is 2 pixels of 512, less along them."""
    landmarks = drawn_landmarks() * (SIZE / DRAWN)
    everywhere = np.ones((SIZE, SIZE), bool)
    moved = features.distances(normals((0, 0)), normals((0.5, 0)), everywhere, landmarks)
    assert set(moved) == {*features.LINES, "all"}
    assert 0.5 < np.median(moved["all"]) < 2.1
    still = features.distances(normals((0, 0)), normals((0, 0)), everywhere, landmarks)
    assert np.quantile(still["all"], 0.9) < 0.1


def test_halo_compares_with_the_error_elsewhere() -> None:
    """1 for an error that is the same everywhere, 3 for one three times as large at the lines."""
    landmarks = drawn_landmarks() * (SIZE / DRAWN)
    mask = np.ones((SIZE, SIZE), bool)
    beside = np.any(list(features.near(landmarks, SIZE).values()), axis=0)
    assert beside.any() and not beside.all()
    assert features.halo(np.ones((SIZE, SIZE)), mask, landmarks) == pytest.approx(1)
    assert features.halo(np.where(beside, 3.0, 1.0), mask, landmarks) == pytest.approx(3)
