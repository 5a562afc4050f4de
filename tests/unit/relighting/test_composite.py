"""How the relit face fades into its photo."""

import numpy as np
import pytest

from unlit.photo.crop import Crop
from unlit.relighting.composite import continued, feathered

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


def test_the_tint_goes_on_beyond_the_face() -> None:
    """A face with an orange half: the neck below has one, too; on the face nothing changes."""
    tint = np.where(COLUMNS[..., None] < 60, (0.4, 0.0, -0.4), 0.0)
    mask = (np.hypot(ROWS - 60, COLUMNS - 60) < 40).astype(np.float32)
    tint = tint * mask[..., None]
    eye = Crop(np.array([[1.0, 0, 0], [0, 1.0, 0]]), SIZE)
    found = continued(tint.astype(np.float32), mask, eye, eye, 4.0)
    np.testing.assert_allclose(found[60, 30:90], tint[60, 30:90], atol=1e-5)
    np.testing.assert_allclose(found[115, 40], (0.4, 0, -0.4), atol=0.02)
    np.testing.assert_allclose(found[115, 80], 0, atol=0.02)
    assert np.abs(np.diff(found[105:], axis=1)).max() < 0.1
