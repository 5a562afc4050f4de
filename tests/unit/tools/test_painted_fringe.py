"""A painted fringe: hair where skin was, nothing else moved, none on a bald head."""

import numpy as np
import pytest
from painted_fringe import painted_fringe

from drawn_face import SIZE, drawn_landmarks, inside
from unlit.perception.parser import CLASSES
from unlit.perception.topology import FACE_OVAL, HAIRLINE, NOSE_BASE

LANDMARKS = drawn_landmarks()
ROWS = np.broadcast_to(np.arange(SIZE)[:, None], (SIZE, SIZE))
SKIN, HAIR, HAND = (CLASSES.index(name) for name in ("skin", "hair", "hand"))
COLOURS = {SKIN: (0.5, 0.3, 0.2), HAIR: (0.05, 0.04, 0.03), HAND: (0.1, 0.6, 0.1)}


def head(bald: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A face of skin, hair above it, a hand that covers the left of the picture."""
    what = np.where(inside(FACE_OVAL, LANDMARKS) > 0, SKIN, 0)
    if not bald:
        what[LANDMARKS[HAIRLINE, 1] + 5 > ROWS] = HAIR
    what[:, : SIZE // 3] = HAND
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.uint8)
    linear = np.zeros((SIZE, SIZE, 3), np.float32)
    for name in (0, *COLOURS):
        shares[what == name, name] = 255
        linear[what == name] = COLOURS.get(name, 0)
    return linear, shares


@pytest.mark.parametrize("seed", range(6))
def test_skin_turns_to_hair_and_nothing_else_changes(seed: int) -> None:
    """What skin loses hair gains; it looks like hair where all of it is; the rest stays."""
    linear, shares = head()
    drawn, covered = painted_fringe(linear, shares, LANDMARKS, np.random.default_rng(seed))
    lost = shares[..., SKIN].astype(int) - covered[..., SKIN]
    gained = covered[..., HAIR].astype(int) - shares[..., HAIR]
    assert (lost >= 0).all() and np.abs(gained - lost).max() <= 1
    assert lost.any()
    assert not lost[LANDMARKS[NOSE_BASE, 1] < ROWS].any()
    np.testing.assert_array_equal(covered[..., HAND], shares[..., HAND])
    np.testing.assert_array_equal(drawn[shares[..., HAND] > 0], linear[shares[..., HAND] > 0])
    now_hair = (lost > 250) & (shares[..., SKIN] == 255)
    assert drawn.dtype == np.float32 and np.isfinite(drawn).all() and drawn.min() >= 0
    assert np.median(drawn[now_hair]) < 0.2


def test_a_bald_head_stays_bald() -> None:
    """No hair says what colour it has."""
    linear, shares = head(bald=True)
    drawn, covered = painted_fringe(linear, shares, LANDMARKS, np.random.default_rng(0))
    assert drawn is linear and covered is shares
