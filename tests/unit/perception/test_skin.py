"""Skin or hair, on a drawn face of which every pixel is known."""

from __future__ import annotations

import numpy as np
import pytest

from drawn_face import EYES, MIDDLE, SIZE, drawn_face, drawn_landmarks, inside
from unlit.perception.skin import visible_face
from unlit.perception.topology import FACE_OVAL, LEFT_EYE, LIPS_OUTER

LANDMARKS = drawn_landmarks()
OVAL = inside(FACE_OVAL, LANDMARKS)
HAIR = np.array([0.03, 0.02, 0.012])
ROWS, COLUMNS = np.indices((SIZE, SIZE))


def overlap(mask: np.ndarray, truth: np.ndarray) -> float:
    """Intersection over union."""
    found = mask > 0.5
    return float((found & truth).sum() / (found | truth).sum())


def test_a_bare_face_is_its_oval() -> None:
    """All of it, lips and eyes as well, and nothing of the wall."""
    mask = visible_face(drawn_face(LANDMARKS), LANDMARKS)
    assert mask.dtype == np.float32 and mask.min() >= 0 and mask.max() <= 1
    assert overlap(mask, OVAL) > 0.93
    assert mask[inside(LIPS_OUTER, LANDMARKS)].min() > 0.9
    assert mask[inside(LEFT_EYE, LANDMARKS)].min() > 0.9
    assert mask[:, :30].max() == 0


@pytest.mark.parametrize("side", [-1, 1])
def test_hair_over_one_side_is_cut_out(side: int) -> None:
    """A curtain of hair from the temple to the jaw, on either side."""
    curtain = side * (COLUMNS - MIDDLE[0]) > 50
    image = drawn_face(LANDMARKS)
    image[curtain] = HAIR * np.random.default_rng(1).normal(1, 0.1, (curtain.sum(), 1))
    mask = visible_face(image, LANDMARKS)
    assert mask[curtain & OVAL].mean() < 0.15
    assert overlap(mask, OVAL & ~curtain) > 0.9


@pytest.mark.parametrize("shadow", [MIDDLE[0] > COLUMNS, ROWS < EYES - 15])
def test_a_hard_shadow_is_skin(shadow: np.ndarray) -> None:
    """A fifth of the light on one half, or on the forehead alone: the same mask."""
    dim = drawn_face(LANDMARKS) * np.where(shadow, 0.2, 1)[..., None].astype(np.float32)
    assert overlap(visible_face(dim, LANDMARKS), OVAL) > 0.93


def test_a_hairline_above_the_landmarks_is_found() -> None:
    """Skin goes on above the landmarks' oval up to hair that starts there: half of that is found,
    and none of the hair."""
    image = drawn_face(LANDMARKS)
    top = MIDDLE[1] - 100
    forehead = (top + 40 > ROWS) & (top - 15 < ROWS) & (np.abs(COLUMNS - MIDDLE[0]) < 40)
    hair = (top - 15 >= ROWS) & (np.abs(COLUMNS - MIDDLE[0]) < 90)
    noise = np.random.default_rng(2).normal(1, 0.03, (SIZE, SIZE, 1))
    image[forehead] = (image[150, 100] * noise)[forehead]
    image[hair] = (HAIR * noise)[hair]
    mask = visible_face(image, LANDMARKS)
    assert mask[forehead & ~OVAL & (top - 8 < ROWS)].mean() > 0.5
    assert mask[hair].max() < 0.5


def test_a_mole_leaves_no_hole() -> None:
    """What is unlike skin but enclosed by it belongs to the face."""
    image = drawn_face(LANDMARKS)
    mole = (ROWS - 190) ** 2 + (COLUMNS - 85) ** 2 < 25
    image[mole] = HAIR
    assert visible_face(image, LANDMARKS)[mole].min() > 0.9
