"""Adam, against the textbook in NumPy."""

import drjit as dr
import numpy as np
import pytest

from unlit.machine.runtime import mitsuba
from unlit.optimize.optimizer import Adam

mi = mitsuba()

ITERATIONS, HOLD, FLOOR, CLIP = 12, 0.4, 0.1, 0.5


def slope(x: np.ndarray, k: int) -> np.ndarray:
    """A gradient with elements within and beyond the clip, changing every step."""
    return np.sin(3 * x + k) * np.linspace(0.1, 2, x.shape[-1])


def textbook(x: np.ndarray, rate: float, uniform: bool) -> np.ndarray:
    first, second = np.zeros_like(x), np.zeros_like(x)
    for k in range(ITERATIONS):
        g = np.clip(slope(x, k), -CLIP, CLIP)
        first, second = 0.9 * first + 0.1 * g, 0.999 * second + 0.001 * g**2
        m, v = first / (1 - 0.9 ** (k + 1)), second / (1 - 0.999 ** (k + 1))
        share = np.interp(k / (ITERATIONS - 1), [HOLD, 1], [0, 1])
        decay = FLOOR + (1 - FLOOR) * 0.5 * (1 + np.cos(np.pi * share))
        x = x - rate * decay * m / (np.sqrt(v.max() if uniform else v) + 1e-8)
    return x


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("kind", ["Float", "Vector3f"])
def test_adam_is_the_textbooks(kind: str, uniform: bool) -> None:
    """Moments, bias correction, clipping before the moments, full rate, then the cosine."""
    shape = (7,) if kind == "Float" else (3, 7)
    start = np.random.default_rng(0).standard_normal(shape)
    array = getattr(mi, kind)
    names = frozenset({"x"}) if uniform else frozenset()
    begin = {"x": array(start.astype(np.float32))}
    adam = Adam(begin, {"x": 0.05}, ITERATIONS, HOLD, FLOOR, CLIP, names)
    for k in range(ITERATIONS):
        g = slope(adam["x"].numpy(), k)
        dr.backward(dr.sum(adam["x"] * array(g.astype(np.float32)), axis=None))
        adam.step()
    assert adam["x"].numpy() == pytest.approx(textbook(start, 0.05, uniform), abs=2e-5)


def test_rate_zero_freezes() -> None:
    """A parameter without a rate stays, and carries no gradient."""
    adam = Adam({"a": mi.Float(1, 2), "b": mi.Float(3)}, {"a": 0.1, "b": 0.0}, 5, 0.0, 0.1, 1.0)
    assert not dr.grad_enabled(adam["b"])
    dr.backward(dr.sum(dr.square(adam["a"])) * adam["b"])
    adam.step()
    assert adam["b"].numpy() == 3
    assert adam["a"].numpy() == pytest.approx([0.9, 1.9], abs=1e-5)


def test_assignment_keeps_the_gradient_on() -> None:
    """A parameter put back by the caller (normalised, clipped) can go on being optimised."""
    adam = Adam({"a": mi.Float(3, 4)}, {"a": 0.1}, 5, 0.0, 0.1, 1.0)
    adam["a"] = adam["a"] / 5
    assert dr.grad_enabled(adam["a"])
    dr.backward(dr.sum(adam["a"]))
    adam.step()
    assert adam["a"].numpy() == pytest.approx([0.5, 0.7], abs=1e-5)


def test_converges() -> None:
    """A quadratic's minimum is found."""
    adam = Adam({"a": mi.Float(3, -4)}, {"a": 0.2}, 200, 0.0, 0.02, 1.0)
    for _ in range(200):
        dr.backward(dr.sum(dr.square(adam["a"] - mi.Float(1, 2))))
        adam.step()
    assert adam["a"].numpy() == pytest.approx([1, 2], abs=0.02)
