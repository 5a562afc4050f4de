"""The blur of the normals on the mask's pixels."""

import drjit as dr
import numpy as np
import pytest

from unlit.machine.runtime import mitsuba
from unlit.optimize.blur import Blur
from unlit.scene.maps import blur

mi = mitsuba()

WIDTH, HEIGHT = 17, 12


@pytest.fixture
def pixel() -> np.ndarray:
    """A ragged mask that touches all four edges of the image."""
    return np.flatnonzero(np.random.default_rng(1).random(WIDTH * HEIGHT) > 0.3)


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_blur_is_the_maps_blur(pixel: np.ndarray, sigma: float) -> None:
    """Equal to scene.maps.blur of the image that is zero outside the mask, read inside it."""
    rows = np.random.default_rng(2).standard_normal((len(pixel), 3)).astype(np.float32)
    image = np.zeros((HEIGHT * WIDTH, 3), np.float32)
    image[pixel] = rows
    expected = blur(image.reshape(HEIGHT, WIDTH, 3), sigma).reshape(-1, 3)[pixel]
    ours = Blur(pixel, WIDTH, HEIGHT, sigma)(mi.Vector3f(np.ascontiguousarray(rows.T)))
    assert pytest.approx(expected, abs=1e-5) == ours.numpy().T


def test_blur_is_its_own_adjoint(pixel: np.ndarray) -> None:
    """<B x, y> = <x, B y>, which is what its gradient relies on."""
    x, y = np.random.default_rng(3).standard_normal((2, 3, len(pixel))).astype(np.float32)
    operator = Blur(pixel, WIDTH, HEIGHT, 1.0)
    bx, by = (operator.apply(mi.Vector3f(v)).numpy() for v in (x, y))
    assert (bx * y).sum() == pytest.approx((x * by).sum(), rel=1e-4)
    values = mi.Vector3f(x)
    dr.enable_grad(values)
    dr.backward(dr.sum(dr.dot(operator(values), mi.Vector3f(y))))
    assert dr.grad(values).numpy() == pytest.approx(by, abs=1e-5)
