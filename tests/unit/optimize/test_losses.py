"""The terms of the loss, against NumPy."""

import drjit as dr
import numpy as np
import pytest

from unlit.color import UNCLIPPED, encode_srgb
from unlit.machine.runtime import mitsuba
from unlit.optimize.losses import (
    Neighbours,
    encode,
    image_l1,
    landmark_l2,
    normal_l2,
    shape_l2,
    total_variation,
)

mi = mitsuba()

RNG = np.random.default_rng(0)


def columns(rows: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(rows.T, dtype=np.float32)


def test_encode_is_srgb() -> None:
    """The same curve as color.encode_srgb, beyond 1 too, and no infinite slope at 0."""
    linear = np.array([0, 1e-4, 0.0031, 0.0032, 0.2, 1.0, 2.5], np.float32)
    assert encode(mi.Float(linear)).numpy()[1:] == pytest.approx(encode_srgb(linear)[1:], abs=1e-5)
    dark = mi.Float(0, 1e-6, 2e-5)
    dr.enable_grad(dark)
    dr.backward(encode(dark))
    assert dr.grad(dark).numpy() == pytest.approx([0, 0, 12.92], abs=1e-3)


def test_image_l1() -> None:
    """Weighted mean over pixels and channels of encoded differences, both sides as exposed."""
    render = RNG.uniform(0, 1.5, (40, 3))
    target = np.clip(RNG.uniform(0, 1, (40, 3)), *UNCLIPPED)
    weight = RNG.uniform(0, 1, 40)
    weight /= weight.sum()
    expected = (
        weight[:, None] * np.abs(np.clip(encode_srgb(render), *UNCLIPPED) - target)
    ).sum() / 3
    ours = image_l1(mi.Color3f(columns(render)), mi.Color3f(columns(target)), mi.Float(weight))
    assert ours.numpy() == pytest.approx(expected, rel=1e-4)


def test_saturated_on_both_sides_costs_nothing() -> None:
    """A highlight the photo clipped may be any brighter in the render."""
    target = mi.Color3f(UNCLIPPED[1])
    assert image_l1(mi.Color3f(7.0), target, mi.Float(1)).numpy() == pytest.approx(0, abs=1e-6)
    assert image_l1(mi.Color3f(0.5), target, mi.Float(1)).numpy() > 0.2


def test_neighbours_at_the_borders() -> None:
    """No pixel neighbours across the image's edge, or one outside the mask."""
    mask = np.ones((4, 5), dtype=bool)
    mask[1, 2] = mask[2, 4] = False
    pixel = np.flatnonzero(mask)
    neighbours = Neighbours.of(pixel, 5, 4)
    right, below = neighbours.right.numpy(), neighbours.below.numpy()
    for k, p in enumerate(pixel):
        y, x = divmod(p, 5)
        r = x + 1 < 5 and mask[y, x + 1]
        b = y + 1 < 4 and mask[y + 1, x]
        assert pixel[right[k]] == (p + 1 if r else p)
        assert pixel[below[k]] == (p + 5 if b else p)


@pytest.mark.parametrize("channels", [1, 3])
def test_total_variation(channels: int) -> None:
    """Mean over pixels and channels of both absolute differences inside the mask."""
    mask = RNG.random((9, 11)) > 0.2
    image = RNG.standard_normal((9, 11, channels)).astype(np.float32)
    pixel = np.flatnonzero(mask)
    across = np.abs(np.diff(image, axis=1))[mask[:, 1:] & mask[:, :-1]].sum()
    down = np.abs(np.diff(image, axis=0))[mask[1:] & mask[:-1]].sum()
    rows = image.reshape(-1, channels)[pixel]
    values = mi.Float(rows[:, 0]) if channels == 1 else mi.Color3f(columns(rows))
    ours = total_variation(values, Neighbours.of(pixel, 11, 9)).numpy()
    assert ours == pytest.approx((across + down) / (channels * len(pixel)), rel=1e-5)
    assert total_variation(type(values)(0.3) + 0 * values, Neighbours.of(pixel, 11, 9)).numpy() == 0


def test_quadratic_terms() -> None:
    """Means of squared distances, in the units given."""
    a, b = RNG.standard_normal((2, 30, 3))
    weight = RNG.random(30)
    weight /= weight.sum()
    first, second = (mi.Point2f(columns(x[:, :2])) for x in (a, b))
    expected = (weight * (((a - b)[:, :2] / 7) ** 2).sum(axis=1)).sum()
    found = landmark_l2(first, second, mi.Float(weight), 7.0).numpy()
    assert found == pytest.approx(expected, rel=1e-4)
    first, second = (mi.Point3f(columns(x)) for x in (a, b))
    expected = (((a - b) / 2) ** 2).sum(axis=1).mean()
    assert shape_l2(first, second, 2.0).numpy() == pytest.approx(expected, rel=1e-4)
    expected = (a**2).sum(axis=1).mean()
    assert normal_l2(mi.Vector3f(columns(a))).numpy() == pytest.approx(expected, rel=1e-4)
