"""Image metrics."""

import numpy as np
import pytest

from unlit.color import decode_srgb
from unlit.errors import MachineError
from unlit.evaluate import metrics
from unlit.evaluate.metrics import (
    angle,
    best_gain,
    compare,
    flip,
    psnr,
    psnr_linear,
    ssim,
    surface_distance,
)

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


def test_linear_psnr() -> None:
    """A uniform error of a hundredth is 40 dB in linear values."""
    mask = np.ones((10, 10), bool)
    a = np.full((10, 10, 3), 0.5)
    assert psnr_linear(a, a + 0.01, mask) == pytest.approx(40)


def test_ssim_and_flip() -> None:
    """Alike is 1 and 0; noise is less alike than a small shift of brightness; the mask counts."""
    pytest.importorskip("flip_evaluator")
    rng = np.random.default_rng(1)
    y, x = np.mgrid[0:64, 0:64] / 64
    picture = np.stack([0.3 + 0.4 * x, 0.5 * y, 0.5 + 0 * x], axis=2).astype(np.float32)
    noisy = np.clip(picture + 0.2 * rng.standard_normal(picture.shape), 0, 1).astype(np.float32)
    brighter = np.clip(picture + 0.02, 0, 1)
    whole = np.ones((64, 64), bool)
    assert ssim(picture, picture, whole) == pytest.approx(1)
    assert flip(picture, picture, whole) == pytest.approx(0, abs=1e-6)
    assert ssim(noisy, picture, whole) < 0.5 < 0.98 < ssim(brighter, picture, whole)
    assert flip(brighter, picture, whole) < 0.2 < flip(noisy, picture, whole)
    left = x < 0.3
    half = np.where((x < 0.7)[..., None], picture, noisy)
    assert ssim(half, picture, left) == pytest.approx(1, abs=1e-6)
    assert flip(half, picture, left) < 0.01


def test_flip_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its package: one line that says what to install."""
    monkeypatch.setitem(__import__("sys").modules, "flip_evaluator", None)
    with pytest.raises(MachineError, match=r"pip install 'unlit\[evaluate\]'"):
        metrics.flip_package()


def test_compare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half as bright is perfect after one gain; outside the mask both are black, for crop too."""
    monkeypatch.setattr(metrics, "lpips", lambda *_: 0.0)
    monkeypatch.setattr(metrics, "flip", lambda *_: 0.0)
    truth = RNG.uniform(0.2, 0.6, (40, 40, 3)).astype(np.float32)
    mask = np.zeros((40, 40), bool)
    mask[10:30, 10:30] = True
    image = np.where(mask[..., None], 0.5 * truth, 7.0)
    found = compare(image, truth, mask)
    assert found["gain"] == pytest.approx(2, rel=2e-3)
    assert found["gained"]["face"]["psnr"] > 60
    assert found["raw"]["face"]["psnr"] < 20
    # A quarter of the picture carries the error.
    crop = found["raw"]["face"]["psnr"] + 10 * np.log10(4)
    assert found["raw"]["crop"]["psnr"] == pytest.approx(crop)


def test_surface_distance() -> None:
    """A moved copy lies on the surface; a bump of 0.5 on a tenth of it is found, not spread."""
    y, x = np.mgrid[-8:8:81j, -8:8:81j]
    z = 3 * np.cos(0.35 * x) + 2 * np.sin(0.45 * y) + 0.1 * x * y
    truth = np.stack([x, y, z], axis=-1)
    dx, dy = np.gradient(z, 0.2)[1], np.gradient(z, 0.2)[0]
    normals = np.stack([-dx, -dy, np.ones_like(z)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    angle = np.radians(6)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    inner = np.s_[10:71, 10:71]
    flat = (truth.reshape(-1, 3), normals.reshape(-1, 3))
    moved = truth[inner].reshape(-1, 3) @ turn.T + (0.4, -0.3, 0.5)
    assert surface_distance(moved, *flat)["p95"] < 0.01
    bumpy = truth.copy()
    bumpy[30:45, 30:50] += 0.5 * normals[30:45, 30:50]
    found = surface_distance(bumpy[inner].reshape(-1, 3) @ turn.T + (0.4, -0.3, 0.5), *flat)
    assert found["median"] < 0.02
    assert found["p95"] == pytest.approx(0.5, abs=0.05)
