"""The landmarker's error: what is put in is learnt, mirrored photos agree, the shipped one fits."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_errors import _expression, _light, partners

from unlit.head.landmark_error import LandmarkError, learn, shipped_error
from unlit.head.model import LANDMARKS, HeadModel


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


def test_shipped_error_is_mirrored_and_small(head: HeadModel) -> None:
    """A head turned the other way errs the other way; a centimetre is the landmarker's worst."""
    error, mirror = shipped_error(), partners(head)
    for yaw in (0.0, 0.3, 0.6):
        left, right = error.expected(yaw, 0.1), error.expected(-yaw, 0.1)
        np.testing.assert_allclose(left[mirror] * (-1, 1), right, atol=0.02)
        assert np.abs(left).max() < 1.5


def test_partners_are_mutual(head: HeadModel) -> None:
    """And named points are known to be each other's: eye corners, mouth corners, nose tip."""
    mirror = partners(head)
    for left, right in ((33, 263), (133, 362), (61, 291), (4, 4)):
        assert mirror[left] == right
        assert mirror[right] == left


def test_simulated_heads_stay_within_bounds(head: HeadModel) -> None:
    """Expressions in [0, 1], on both sides alike; light is finite and nowhere negative."""
    rng = np.random.default_rng(1)
    names = head.expression_names
    for _ in range(20):
        strengths = _expression(head, rng)
        assert strengths.min() >= 0 and strengths.max() <= 0.7
        smile = [strengths[names.index(f"mouthSmile{side}")] for side in ("Left", "Right")]
        assert smile[0] == smile[1]
    light = _light(rng)
    assert np.isfinite(light).all() and light.min() >= 0
