"""How the relit face fades into its photo."""

import numpy as np
import pytest

from unlit.relighting.composite import feathered

SIZE = 120
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE]


@pytest.mark.parametrize("row", [60, 25])
def test_the_rim_fades(row: int) -> None:
    """A disc, whole or cut by the crop's border: no step at the outline, whole well inside."""
    distance = np.hypot(ROWS - row, COLUMNS - 60)
    mask = (distance < 40).astype(np.float32)
    weight = feathered(mask)
    assert weight.dtype == np.float32
    assert (weight[mask == 0] == 0).all()
    steps = [np.abs(np.diff(np.pad(weight, 1), axis=axis)).max() for axis in (0, 1)]
    assert max(steps) < 0.3  # a fade of 7 pixels
    assert (weight[(distance < 30) & (ROWS > 10)] == 1).all()
    assert 0 < weight[row, 60 - 38] < 0.5


def test_holes_and_slots_stay_sharp() -> None:
    """An eye, and a bar as glasses' frames are that runs out of the face: no fade along them."""
    mask = (np.hypot(ROWS - 60, COLUMNS - 60) < 50).astype(np.float32)
    eye = np.hypot(ROWS - 70, COLUMNS - 75) < 8
    bar = (np.abs(ROWS - 45) < 2) & (COLUMNS > 40)
    mask[eye | bar] = 0
    weight = feathered(mask)
    assert (weight[eye | bar] == 0).all()
    beside = (np.hypot(ROWS - 70, COLUMNS - 75) < 10) & ~eye
    beside |= (np.abs(ROWS - 45) < 4) & (COLUMNS > 40) & (COLUMNS < 90) & ~bar
    assert (weight[beside] == 1).all()


def test_small_faces() -> None:
    """A pixel of a face, and none."""
    mask = np.zeros((8, 8), np.float32)
    assert (feathered(mask) == 0).all()
    mask[3, 3] = 1
    assert feathered(mask)[3, 3] > 0
