"""Sealing a head's lips, and how far landmarks say a mouth is open."""

import numpy as np
import pytest

from unlit.head.lips import LOWER_RIM, UPPER_RIM, opening, seal_lips
from unlit.head.model import HeadModel


def test_opening_is_height_over_width() -> None:
    """Of a mouth 8 wide whose rims lie 2 apart; the ends of the rims do not count."""
    points = np.zeros((478, 2))
    points[list(UPPER_RIM), 0] = points[list(LOWER_RIM), 0] = np.linspace(0, 8, 11)
    points[list(UPPER_RIM[1:-1]), 1] = -2
    assert opening(points) == pytest.approx(0.25)


def test_seal_moves_only_the_mouth(head: HeadModel) -> None:
    """Sealing leaves nose, chin and eyes where they are."""
    expression = np.zeros(len(head.expression))
    expression[head.expression_names.index("jawOpen")] = 0.1
    shape = head.vertices(np.zeros(len(head.identity)), expression)
    sealed = seal_lips(head, shape)
    before, after = head.landmarks(shape), head.landmarks(sealed)
    assert before[13, 1] - before[14, 1] > 0.1
    assert after[13, 1] - after[14, 1] < 0.01
    np.testing.assert_array_equal(before[[4, 152, 159, 468]], after[[4, 152, 159, 468]])
