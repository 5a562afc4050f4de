"""Heights over the surface behind the pixels, and the normals that they make."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from unlit.scene.camera import Camera
from unlit.scene.height import PixelFrames

SIZE = 48
CAMERA = Camera(SIZE, SIZE, 60.0, SIZE / 2 + 3, SIZE / 2 - 2)
NORMAL = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])


def plane(pixel: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
    """Where the pixels' rays meet a tilted plane 50 cm away, moved by `offset` along its normal."""
    ray = CAMERA.directions().reshape(-1, 3)[pixel].astype(np.float64)
    middle = np.array([0.0, 0.0, -50.0])
    return ray * ((middle @ NORMAL + offset) / (ray @ NORMAL))[:, None]


@pytest.fixture(scope="module")
def frames() -> PixelFrames:
    ys, xs = np.mgrid[0:SIZE, 0:SIZE]
    pixel = np.flatnonzero(np.hypot(xs - 24, ys - 22).ravel() < 18)
    position = plane(pixel)
    return PixelFrames.of(CAMERA, pixel, position, np.tile(NORMAL, (len(pixel), 1)))


def smooth(frames: PixelFrames, seed: int, sigma: float = 3.0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal((SIZE, SIZE))
    field = ndimage.gaussian_filter(noise, sigma, mode="wrap").ravel()[frames.pixel]
    return 0.06 * (field - field.mean()) / field.std()


def test_frames_step_to_the_neighbouring_pixels(frames: PixelFrames) -> None:
    """To first order: half a step of both neighbours."""
    inner = frames.pixel[len(frames.pixel) // 2]
    row = np.flatnonzero(frames.pixel == inner)[0]
    for step, ahead in ((frames.across, 1), (frames.down, SIZE)):
        two = plane(np.array([inner + ahead])) - plane(np.array([inner - ahead]))
        np.testing.assert_allclose(step[row], two[0] / 2, rtol=2e-3, atol=1e-4)
    assert np.all(frames.facing > 0.7)


def test_the_perturbation_is_the_normal_of_the_moved_surface(frames: PixelFrames) -> None:
    """Against cross products of the moved points themselves."""
    height = smooth(frames, 1)
    e = frames.perturbation_of(height)
    image = np.full((SIZE, SIZE, 3), np.nan)
    image.reshape(-1, 3)[frames.pixel] = plane(frames.pixel) + height[:, None] * NORMAL
    across = (image[1:-1, 2:] - image[1:-1, :-2]) / 2
    down = (image[2:, 1:-1] - image[:-2, 1:-1]) / 2
    true = np.full((SIZE, SIZE, 3), np.nan)
    true[1:-1, 1:-1] = np.cross(down, across)
    true = true.reshape(-1, 3)[frames.pixel]
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    found = NORMAL + e
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    known = np.isfinite(true).all(axis=1)
    tilt = np.linalg.norm(true - NORMAL, axis=1)[known]
    error = np.linalg.norm(found - true, axis=1)[known]
    assert tilt.max() > 0.02
    assert error.max() < 0.05 * tilt.max()


def test_a_height_is_found_again(frames: PixelFrames) -> None:
    height = smooth(frames, 2)
    ones = np.ones(len(height))
    found = frames.height_of(frames.perturbation_of(height), ones, flatness=1e-6)
    assert np.corrcoef(found, height)[0, 1] > 0.99
    assert found.std() == pytest.approx(height.std(), rel=0.1)


def test_what_is_no_gradient_is_left_out(frames: PixelFrames) -> None:
    """A rotation about the middle has no height; pixels without weight do not say anything."""
    height = smooth(frames, 3)
    e = frames.perturbation_of(height)
    swirl = np.cross(NORMAL, frames.perturbation_of(smooth(frames, 4)))
    ones = np.ones(len(height))
    found = frames.height_of(e + swirl, ones, flatness=1e-6)
    assert np.corrcoef(found, height)[0, 1] > 0.9
    weight = ones.copy()
    weight[: len(weight) // 2] = 0
    spoilt = e.copy()
    spoilt[: len(weight) // 2 - 40] += 5.0
    found = frames.height_of(spoilt, weight, flatness=1e-6)
    rest = slice(len(weight) // 2 + 40, None)
    assert np.corrcoef(found[rest], height[rest])[0, 1] > 0.95
