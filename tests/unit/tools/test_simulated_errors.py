"""Learning the landmarker's mean error: what is put in is learnt."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_errors import learn

from unlit.head.landmark_error import LandmarkError
from unlit.head.model import LANDMARKS


@pytest.fixture(scope="module")
def learnt() -> LandmarkError:
    """From 2000 examples: all points move 0.4 cm a radian of yaw, and by chance up and down.

    Points 2 k and 2 k + 1 are each other's mirror image.
    """
    rng = np.random.default_rng(0)
    yaw, pitch = rng.uniform(-0.7, 0.7, 2000), rng.uniform(-0.3, 0.3, 2000)
    errors = np.zeros((2000, LANDMARKS, 2))
    errors[..., 0] += 0.4 * yaw[:, None]
    errors[..., 1] += 0.3 * rng.standard_normal(2000)[:, None]
    errors += 0.05 * rng.standard_normal(errors.shape)
    mirror = np.arange(LANDMARKS) ^ 1
    return learn(errors, yaw, pitch, mirror)


def test_the_mean_follows_the_turn(learnt: LandmarkError) -> None:
    """Also beyond what was seen, where it stays what it was at the limit."""
    expected = learnt.expected(0.5, 0.1)
    np.testing.assert_allclose(expected[:, 0], 0.2, atol=0.03)
    np.testing.assert_allclose(expected[:, 1], 0, atol=0.03)
    np.testing.assert_array_equal(learnt.expected(2.0, 0.1), learnt.expected(0.75, 0.1))
