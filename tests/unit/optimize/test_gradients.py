"""Gradients of the image loss with respect to every parameter, against central differences."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from bumpy_head import bumpy_head, camera, painted


@pytest.fixture(scope="module")
def case(gradients: ModuleType) -> Any:
    return gradients.Case(*bumpy_head(), camera(80), painted(80))


def test_gradients_match_central_differences(case: Any) -> None:
    """Within 1 % along random directions, vertices (with visibility fixed) within 5 %."""
    for name, result in case.check(6).items():
        assert np.abs(result.numeric).max() > 1e-5, name
        assert result.error < (0.05 if name == "vertices" else 0.01), name


def test_diffuse_albedo_gradient_is_mitsubas(gradients: ModuleType) -> None:
    """Within the noise of Mitsuba's differentiable path tracer, without bias."""
    head = (*bumpy_head(), camera(48), painted(48))
    error, bias = gradients.albedo_beside_mitsuba(*head, samples=256)
    assert error < 0.02
    assert abs(bias) < 0.005
