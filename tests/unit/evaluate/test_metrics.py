"""Image metrics."""

import numpy as np
import pytest

from unlit.color import decode_srgb
from unlit.evaluate.metrics import angle, best_gain, psnr

RNG = np.random.default_rng(0)


def test_best_gain() -> None:
    """Recovers a factor, and looks inside the mask only."""
    truth = RNG.uniform(0.05, 0.8, (20, 20, 3))
    mask = np.zeros((20, 20), dtype=bool)
    mask[5:15, 5:15] = True
    image = np.where(mask[..., None], truth / 1.7, 9.0)
    assert best_gain(image, truth, mask) == pytest.approx(1.7, rel=0.01)


def test_psnr() -> None:
    """A uniform error of a tenth in encoded values is 20 dB; outside the mask nothing counts."""
    mask = np.zeros((10, 10), dtype=bool)
    mask[:5] = True
    encoded = np.full((10, 10, 3), 0.5, np.float32)
    other = encoded + 0.1
    other[5:] = 0
    a, b = decode_srgb(encoded), decode_srgb(other)
    assert psnr(a, b, mask) == pytest.approx(20, abs=0.01)
    assert psnr(a, a, mask) >= 100


def test_angle() -> None:
    """Mean angle in degrees."""
    up = np.zeros((4, 4, 3))
    up[..., 2] = 1
    tilted = up.copy()
    tilted[:2] = (np.sin(np.radians(30)), 0, np.cos(np.radians(30)))
    assert angle(tilted, up, np.ones((4, 4), bool)) == pytest.approx(15)
