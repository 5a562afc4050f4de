"""The coarse surface of a person, and what light does to it."""

from __future__ import annotations

import numpy as np
import pytest

from small_head import small_head
from unlit.photo.crop import Crop
from unlit.relighting.body import GRID, Body, Lattice, inflated
from unlit.relighting.person import Person, around
from unlit.relighting.quotient import BodyUnderLight, Quotient, SkinMatch
from unlit.scene.light import disc, flash, uniform

SIDE = 2.0


def test_values_of_least_energy() -> None:
    """A string held at its ends is straight; where nothing holds, it follows."""
    mask = np.zeros((5, 30), bool)
    mask[2, 4:20] = True
    weight = np.zeros(16)
    weight[[0, 10]] = 1e6
    target = np.zeros(16)
    target[10] = 5
    found = Lattice(mask).smoothest(weight)(target)
    np.testing.assert_allclose(found[:11], np.arange(11) / 2, atol=1e-3)
    np.testing.assert_allclose(found[11:], 5, atol=1e-3)


@pytest.fixture(scope="module")
def body() -> Body:
    """A head with hair 3 cm thick around it, on shoulders."""
    face = small_head(96)
    crop = face.photo.crop
    canvas = around(crop, SIDE, GRID)
    ys, xs = np.mgrid[:GRID, :GRID] / GRID - 0.5
    person = (np.hypot(xs / 0.33, (ys + 0.05) / 0.38) < 1) | ((ys > 0.3) & (np.abs(xs) < 0.45))
    head = np.hypot(xs / 0.2, ys / 0.25) < 1
    # The photo is the canvas itself.
    size = (GRID, GRID)
    eye = Crop(np.eye(2, 3), GRID)
    scale = crop.scale / canvas.scale
    shift = crop.points(canvas.origin)
    moved = Crop(np.array([[scale, 0, shift[0]], [0, scale, shift[1]]]), crop.resolution)
    from changed import changed

    face = changed(face, {"photo.crop": moved})
    alpha = person.astype(np.float32).reshape(size)
    found = inflated(
        face,
        Person(
            alpha,
            np.ones_like(alpha),
            eye,
            SIDE,
            1 - head.astype(np.float32),
            head.astype(np.float32),
        ),
    )
    assert found is not None
    return found


def _at(body: Body, values: np.ndarray) -> np.ndarray:
    return body.lattice.image(values)


def test_the_body_is_closed_and_round(body: Body) -> None:
    count = len(body.lattice.rows)
    front, back = body.vertices[:count], body.vertices[count:]
    assert (front[:, 2] >= back[:, 2] - 1e-4).all()
    corners = body.vertices[body.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    half = len(body.triangles) // 2
    towards = -corners.mean(axis=1)
    assert ((normal[:half] * towards[:half]).sum(axis=1) > 0).mean() > 0.98
    depth = _at(body, -front[:, 2])
    middle = GRID // 2
    inside = depth[middle][body.lattice.mask[middle]]
    assert inside[0] > inside.min() + 5  # the outline lies behind the face
    assert inside[-1] > inside.min() + 5
    # At the face the surface is the head's: its nose is the nearest point of it.
    assert abs(inside.min() - (80 - 10.6)) < 0.5


def test_the_same_light_changes_nothing(body: Body) -> None:
    sky = uniform(0.4)
    found = BodyUnderLight(body, sky, 2 * sky).plain(0)
    np.testing.assert_allclose(found.value, 2, rtol=1e-3)
    np.testing.assert_allclose(found.kept[body.lattice.mask], 1, atol=1e-3)


def test_light_from_the_side(body: Body) -> None:
    """Bright on its side, dark on the other; turned by 180 degrees the other way round."""
    light = disc((0.95, 0.2, 0.3))
    lit = BodyUnderLight(body, uniform(0.5), light, [0.0, 180.0])
    values = [lit.plain(k).value.mean(axis=2) for k in (0, 1)]
    row = GRID // 2 - 10
    columns = np.flatnonzero(body.lattice.mask[row])
    left, right = columns[4], columns[-5]
    assert values[0][row, right] > 4 * values[0][row, left]
    assert values[1].max() < values[0].max()
    assert lit.plain(0).kept[body.lattice.mask].mean() < 0.7


def test_no_light_at_all(body: Body) -> None:
    dark = np.zeros((18, 36), np.float32)
    found = BodyUnderLight(body, flash(), dark).plain(0)
    assert np.isfinite(found.value).all()
    assert found.value.max() < 0.05
    assert np.isfinite(BodyUnderLight(body, dark, flash()).plain(0).value).all()


def test_the_skin_s_quotient_is_met_and_dies_away(body: Body) -> None:
    weight = np.zeros((GRID, GRID), np.float32)
    weight[70:110, 70:110] = 1
    photo = 0.3 * weight[..., None].repeat(3, axis=2)
    plain = Quotient(np.full((GRID, GRID, 3), 0.8, np.float32), np.ones((GRID, GRID), np.float32))
    found = SkinMatch(body, weight, photo)(plain, 1.5 * photo)
    np.testing.assert_allclose(found.value[75:105, 75:105], 1.5, rtol=0.03)
    border = found.value[90, 109:111].mean()
    assert 1.3 < border < 1.51
    assert abs(found.value[160, 96].mean() - 0.8) < 0.05
