"""Path-traced heads with hair and glasses: their truth, and what a camera makes of them."""

import numpy as np
import pytest
import snapshots
import strands
import worn
from dressed import Dressed, Look, Scene, View
from heads import random_head

from unlit.perception.parser import CLASSES, OTHERS

SIZE = 48


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(3)
    head = random_head(rng, spread=0.3)
    hair = strands.hair(head, strands.STYLES["short"], rng)
    grown = {"hair": [hair], "eyebrows": [strands.brows(head, rng)]}
    return Scene(Dressed(head, Look(), grown, worn.glasses(head, rng, "tinted")), View(), SIZE, 2)


def share(scene, name):
    return scene.shares[..., CLASSES.index(name)]


def test_every_ray_is_counted_once(scene):
    np.testing.assert_allclose(scene.shares[..., OTHERS].sum(axis=2), 1, atol=1e-6)


def test_everything_is_where_it_belongs(scene):
    """Background at the upper corners, hair above the forehead, lenses around the eyes, lips."""
    assert share(scene, "background")[:3, :3].min() == 1
    marks = scene.landmarks().astype(int)
    x, y = marks[10]
    assert share(scene, "hair")[: y - 2, x].max() > 0.9
    assert share(scene, "skin")[marks[4, 1], marks[4, 0]] == 1  # the tip of the nose
    for eye in (468, 473):
        assert share(scene, "tinted lens")[marks[eye, 1], marks[eye, 0]] > 0.5
    x, y = ((marks[0] + marks[13]) / 2).astype(int)  # the middle of the upper lip
    assert share(scene, "lips")[y - 1 : y + 2, x].max() > 0
    assert share(scene, "frame").sum() > 5


def test_hair_does_not_grow_into_the_head(scene):
    head, hair = scene.dressed.head, scene.dressed.strands["hair"][0]
    tips = hair.points[:, -1]
    nearest = np.linalg.norm(tips[:200, None] - head.vertices[None, ::7], axis=2).argmin(axis=1)
    out = np.sum((tips[:200] - head.vertices[::7][nearest]) * head.normals[::7][nearest], axis=1)
    assert np.mean(out > 0) > 0.97


def test_the_light_can_be_changed(scene):
    """The second picture is that of a new scene under the second light."""
    first, second = (snapshots.LIGHTS[name]() for name in ("flash", "side"))
    scene.photograph(first, 2)
    picture = scene.photograph(second, 2)
    again = Scene(scene.dressed, View(), SIZE, 2).photograph(second, 2)
    np.testing.assert_allclose(picture, again, rtol=1e-3, atol=1e-4)
    covered, known = picture[..., 3], 1 - share(scene, "background")
    assert np.abs(covered - known).mean() < 0.02


def test_a_camera_makes_a_picture_of_it(scene):
    render = scene.photograph(snapshots.LIGHTS["uniform"](), 2)
    rng = np.random.default_rng(0)
    picture = snapshots.developed(render, snapshots.background(SIZE, rng), rng)
    assert picture.shape == (SIZE, SIZE, 3)
    assert picture.dtype == np.uint8
    inside = share(scene, "skin") > 0.9
    assert 40 < np.median(picture[inside]) < 250


def test_clear_lenses_let_light_through():
    """Under a small light, what lies behind a lens is as bright as without it, but for gloss."""
    rng = np.random.default_rng(3)
    head = random_head(rng, spread=0.3)
    glasses = worn.glasses(head, rng, "clear")
    light = snapshots.LIGHTS["flash"]()
    seen, bare = (
        Scene(Dressed(head, Look(), {}, pieces), View(), SIZE, 2) for pieces in (glasses, [])
    )
    behind = (share(seen, "clear lens") > 0.9) & (share(seen, "frame") == 0)
    assert behind.sum() > 20
    through, without = (s.photograph(light, 8)[behind][:, :3].mean() for s in (seen, bare))
    assert through == pytest.approx(without, rel=0.3)


def test_stubble_is_skin_and_a_beard_is_not():
    rng = np.random.default_rng(5)
    head = random_head(rng, spread=0.3)
    (grown,) = strands.beard(head, "short", rng).values()
    skins = [
        share(Scene(Dressed(head, Look(), {kind: grown}), View(), SIZE, 2), "skin").sum()
        for kind in ("stubble", "beard")
    ]
    bare = share(Scene(Dressed(head, Look()), View(), SIZE, 2), "skin").sum()
    assert skins[0] >= bare > 1.1 * skins[1]


def test_no_hair_under_a_hat():
    points = np.array([[[0, 0, 0], [0, 1, 0]], [[5, 0, 0], [5, 1, 0]]], float)
    hair = strands.Strands(points, np.full(2, 0.02))
    left = strands.below(hair, [np.array([[0.0, 0.5, 0.0]])])
    np.testing.assert_array_equal(left.points, points[1:])
