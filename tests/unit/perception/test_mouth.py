"""Whether a drawn mouth is open: the gap, what is seen in it, and both together."""

from __future__ import annotations

import numpy as np
import pytest

from drawn_face import drawn_face, drawn_landmarks, inside
from unlit.perception.mouth import mouth_opening, relative_gap, teeth
from unlit.perception.topology import LIPS_INNER

#: The dark is no less red than the lips.
TEETH, DARK = (0.7, 0.65, 0.55), (0.05, 0.012, 0.01)


def opened(gap: float, filled: tuple[float, float, float] | None) -> float:
    """The opening found of a mouth whose landmarks have this gap, filled with a colour."""
    landmarks = drawn_landmarks(gap)
    image = drawn_face(landmarks)
    if filled is not None:
        image[inside(LIPS_INNER, landmarks)] = filled
    return mouth_opening(image, landmarks)


def test_relative_gap_is_height_over_width() -> None:
    """Pairs 1 and 3 apart over corners that are 8 apart."""
    points = np.array([[0, 0], [0, 1], [4, 0], [4, 3], [-2, 1], [6, 1.0]])
    assert relative_gap(points, ((0, 1), (2, 3)), (4, 5)) == pytest.approx(0.25)


def test_closed_lips_are_closed() -> None:
    """No gap, whatever colour is between the lips."""
    assert opened(0.0, None) == 0
    assert opened(0.019, TEETH) == 0
    assert opened(0.04, TEETH) == 1


@pytest.mark.parametrize("filled", [TEETH, DARK])
def test_teeth_or_the_dark_open_a_mouth(filled: tuple[float, float, float]) -> None:
    """A gap in which something unlike lips is seen."""
    assert opened(0.2, filled) == 1


def test_parted_landmarks_on_plain_lips_are_closed() -> None:
    """A gap in which nothing but lip is seen, unless it is wider than any error."""
    assert opened(0.2, None) == 0
    assert opened(0.45, None) == 1
    assert 0 < opened(0.35, None) < 1


def test_teeth_are_told_from_the_dark_and_from_lips() -> None:
    """Half an open mouth has teeth, half is dark; of a mouth full of lip nothing is teeth."""
    landmarks = drawn_landmarks(0.3)
    image = drawn_face(landmarks)
    mouth = inside(LIPS_INNER, landmarks)
    assert teeth(image, landmarks, mouth.astype(float)).sum() < 0.05 * mouth.sum()
    left = mouth & (np.arange(len(image)) < len(image) / 2)
    image[mouth], image[left] = DARK, TEETH
    np.testing.assert_array_equal(teeth(image, landmarks, mouth.astype(float)), left)
    assert not teeth(image, landmarks, 0.0 * mouth).any()
