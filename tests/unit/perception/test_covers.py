"""What covers a face, on shares of which every pixel is set by hand."""

from __future__ import annotations

import numpy as np
import pytest

from drawn_face import SIZE as DRAWN
from drawn_face import drawn_landmarks
from unlit.perception.covers import LEAST, covers
from unlit.perception.parser import CLASSES, SIZE
from unlit.perception.topology import CHIN, HAIRLINE, LEFT_EYE, RIGHT_EYE

LANDMARKS = drawn_landmarks() * (SIZE / DRAWN)
ROWS, COLUMNS = np.indices((SIZE, SIZE)) + 0.5
TOP, CHIN_ROW = LANDMARKS[HAIRLINE, 1], LANDMARKS[CHIN, 1]
MIDDLE, EYES = LANDMARKS[HAIRLINE, 0], LANDMARKS[list(RIGHT_EYE + LEFT_EYE), 1].mean()


def of(name: str, where: np.ndarray) -> dict[str, float]:
    """A face of skin all over, but for one class somewhere."""
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("skin")] = ~where
    shares[..., CLASSES.index(name)] = where
    return covers(shares, LANDMARKS, SIZE)


def test_a_bare_face_has_none() -> None:
    """Not a thousandth."""
    assert max(of("skin", np.zeros((SIZE, SIZE), bool)).values()) == 0


@pytest.mark.parametrize(
    ("name", "part", "where"),
    [
        ("frame", "glasses", (np.abs(ROWS - EYES) < 4)),
        ("tinted lens", "tinted glasses", np.abs(ROWS - EYES) < 15),
        ("beard", "beard", EYES + 45 < ROWS),
        ("hair", "hair", TOP + 20 > ROWS),
        ("cloth", "hat", TOP > ROWS),
        ("hand", "hand or cloth", (CHIN_ROW - 15 < ROWS) & (np.abs(COLUMNS - MIDDLE) < 20)),
        ("cloth", "hand or cloth", CHIN_ROW - 15 < ROWS),
    ],
)
def test_each_is_told_by_its_place(name: str, part: str, where: np.ndarray) -> None:
    """That one, and no other."""
    found = of(name, where)
    assert {what for what, share in found.items() if share >= LEAST[what]} == {part}
    assert found[part] <= (np.inf if part == "hat" else 1)


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("cloth", CHIN_ROW + 3 < ROWS),  # a collar
        ("hair", TOP - 3 > ROWS),
        ("hair", np.abs(COLUMNS - MIDDLE) > 65),
        ("hand", CHIN_ROW + 5 < ROWS),
    ],
)
def test_what_lies_beside_the_face_covers_nothing(name: str, where: np.ndarray) -> None:
    """Hair above it and beside it, a collar, a hand below the chin."""
    found = of(name, where)
    assert all(share < LEAST[what] for what, share in found.items())


def test_shares_are_areas() -> None:
    """Half of the lower face under a beard is a half, at any coverage of its pixels."""
    below = EYES + 40 < ROWS
    left = below & (MIDDLE > COLUMNS)
    assert of("beard", left)["beard"] == pytest.approx(of("beard", below)["beard"] / 2, rel=0.05)
