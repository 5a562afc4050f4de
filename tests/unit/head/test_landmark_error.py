"""The landmarker's mean error as shipped: small, and mirrored heads err in mirrored ways."""

from __future__ import annotations

import numpy as np
from simulated_errors import _expression, _light, partners

from unlit.head.landmark_error import shipped_error
from unlit.head.model import HeadModel


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
