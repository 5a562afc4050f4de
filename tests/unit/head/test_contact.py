"""Eyelids slide on the eyeballs, whatever the model's straight paths do; lips are sealed."""

import numpy as np
import pytest

from unlit.head.contact import eyeballs, lids_outside_eyes, seal_lips
from unlit.head.model import HeadModel


@pytest.mark.parametrize("amount", [0.25, 0.5, 0.75])
def test_lids_slide_on_the_eyeball(head: HeadModel, amount: float) -> None:
    """On its way down no part of the lid lies inside the ball; open eyes hardly change."""
    expression = np.zeros(len(head.expression))
    expression[head.expression_names.index("eyeBlinkRight")] = amount
    shape = head.vertices(np.zeros(len(head.identity)), expression)
    kept = lids_outside_eyes(head, shape)
    for ball in eyeballs(head):
        centre = shape[ball].mean(axis=0)
        radius = np.linalg.norm(shape[ball] - centre, axis=-1).min()
        assert np.linalg.norm(kept[~ball] - centre, axis=-1).min() > radius
        np.testing.assert_array_equal(kept[ball], shape[ball])
    before = np.linalg.norm(shape - kept, axis=-1)
    assert 0 < before.max() < 0.6
    rest = head.landmarks(lids_outside_eyes(head, head.neutral)) - head.landmarks(head.neutral)
    assert np.linalg.norm(rest, axis=-1).max() < 0.1


def test_seal_moves_only_the_mouth(head: HeadModel) -> None:
    """Sealing leaves nose, chin and eyes where they are."""
    expression = np.zeros(len(head.expression))
    expression[head.expression_names.index("jawOpen")] = 0.1
    shape = head.vertices(np.zeros(len(head.identity)), expression)
    sealed = seal_lips(head.landmarks(shape), shape)
    before, after = head.landmarks(shape), head.landmarks(sealed)
    assert before[13, 1] - before[14, 1] > 0.1
    assert after[13, 1] - after[14, 1] < 0.01
    np.testing.assert_array_equal(before[[4, 152, 159, 468]], after[[4, 152, 159, 468]])
