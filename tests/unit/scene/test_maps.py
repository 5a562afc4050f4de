"""Image-space maps."""

import numpy as np
import pytest

from bumpy_head import painted
from unlit.scene.maps import DIFFUSE_BLUR, blur, fill, kernel


def test_kernel_is_a_normalised_gaussian() -> None:
    """Sum 1, symmetric, and the standard deviation asked for."""
    weights = kernel(2.0)
    assert weights.sum() == pytest.approx(1)
    assert weights == pytest.approx(weights[::-1])
    x = np.arange(len(weights)) - len(weights) // 2
    assert np.sqrt((weights * x**2).sum()) == pytest.approx(2.0, rel=0.02)


def test_blur_keeps_constants_inside_and_fades_at_the_edge() -> None:
    """Zero lies beyond the edges; channels do not mix."""
    image = np.zeros((20, 30, 3), dtype=np.float32)
    image[..., 1] = 2.0
    out = blur(image, 1.0)
    assert out[10, 15] == pytest.approx([0, 2, 0])
    assert 0.9 < out[0, 15, 1] < 1.6
    assert out[..., [0, 2]].max() == 0


def test_diffuse_perturbation_is_the_blurred_one() -> None:
    """Paper, section 3.4: one perturbation, blurred by a pixel for the diffuse normal."""
    maps = painted(32)
    assert maps.diffuse_perturbation() == pytest.approx(blur(maps.perturbation, DIFFUSE_BLUR))


def test_fill_takes_the_nearest_known_value() -> None:
    """Known pixels stay, unknown ones copy; nothing known, nothing changed."""
    image = np.arange(20, dtype=np.float32).reshape(4, 5)
    known = np.zeros((4, 5), dtype=bool)
    known[1, 1] = known[3, 4] = True
    out = fill(image, known)
    assert out[1, 1] == 6
    assert out[0, 0] == 6
    assert out[2, 4] == 19
    assert fill(image, np.zeros((4, 5), dtype=bool)) == pytest.approx(image)
