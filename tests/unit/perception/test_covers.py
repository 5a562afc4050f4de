"""What covers a face, on shares of which every pixel is set by hand."""

from __future__ import annotations

import numpy as np
import pytest

from drawn_face import SIZE as DRAWN
from drawn_face import drawn_landmarks
from unlit.perception.covers import LEAST, covers
from unlit.perception.parser import CLASSES, SIZE
from unlit.perception.topology import HAIRLINE, LEFT_EYE, RIGHT_EYE

LANDMARKS = drawn_landmarks() * (SIZE / DRAWN)
ROWS, COLUMNS = np.indices((SIZE, SIZE)) + 0.5
TOP = LANDMARKS[HAIRLINE, 1]
MIDDLE, EYES = LANDMARKS[HAIRLINE, 0], LANDMARKS[list(RIGHT_EYE + LEFT_EYE), 1].mean()


def of(name: str, where: np.ndarray) -> dict[str, float]:
    """A face of skin all over, but for one class somewhere."""
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("skin")] = ~where
    shares[..., CLASSES.index(name)] = where
    return covers(shares, LANDMARKS)


def test_a_bare_face_has_none() -> None:
    """Not a thousandth."""
    assert max(of("skin", np.zeros((SIZE, SIZE), bool)).values()) == 0


@pytest.mark.parametrize(
    ("name", "part", "where"),
    [
        ("frame", "glasses", (np.abs(ROWS - EYES) < 4)),
        ("tinted lens", "tinted glasses", np.abs(ROWS - EYES) < 15),
    ],
)
def test_each_is_told_by_its_place(name: str, part: str, where: np.ndarray) -> None:
    """That one, and no other; a share, not a sum."""
    found = of(name, where)
    assert {what for what, share in found.items() if share >= LEAST[what]} == {part}
    assert found[part] <= 1


@pytest.mark.parametrize(
    ("name", "where"),
    [("frame", TOP - 3 > ROWS), ("tinted lens", TOP > ROWS), ("hair", ROWS > EYES - 20)],
)
def test_what_lies_elsewhere_is_not_worn(name: str, where: np.ndarray) -> None:
    """Glasses pushed up into the hair, and hair that is none."""
    found = of(name, where)
    assert all(share < LEAST[what] for what, share in found.items())


def test_shares_are_areas() -> None:
    """Half of a frame is half as much."""
    whole = np.abs(ROWS - EYES) < 4
    half = whole & (MIDDLE > COLUMNS)
    assert of("frame", half)["glasses"] == pytest.approx(
        of("frame", whole)["glasses"] / 2, rel=0.05
    )
