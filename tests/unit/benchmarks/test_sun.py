"""The sun of the benchmark is where it should be, its measures tell what they claim to."""

from __future__ import annotations

from typing import Any

import numpy as np
import occluders
import pytest
import sun
from scipy import ndimage

from unlit.machine.runtime import mitsuba
from unlit.scene.arrays import device
from unlit.scene.light import latlong_directions, latlong_solid_angles

mi = mitsuba()

SIDE = 96
ALL = np.ones((SIDE, SIDE), bool)


@pytest.mark.parametrize(("high", "beside"), [(20, 0), (45, 90), (70, 45)])
def test_sun_is_where_it_is_said_to_be(high: float, beside: float) -> None:
    """One unit of irradiance over pi in the middle channel, from its direction, and warm."""
    sky = sun.sun_and_sky(high, beside)
    weight = sky.sun * latlong_solid_angles(180, 360)[..., None]
    directions = latlong_directions(180, 360)
    mean = np.einsum("yxc,yxi->ci", weight, directions)
    assert mean[1] / np.linalg.norm(mean[1]) == pytest.approx(sky.direction, abs=0.01)
    facing = np.maximum(directions @ sky.direction, 0)[..., None]
    red, green, blue = (weight * facing).sum(axis=(0, 1)) / np.pi
    assert green == pytest.approx(1, abs=1e-4)
    assert red > green > blue
    assert np.degrees(np.arcsin(sky.direction[1])) == pytest.approx(high)
    assert np.degrees(np.arctan2(sky.direction[0], sky.direction[2])) == pytest.approx(beside)


def test_sky_is_blue_and_the_ground_lit_by_both() -> None:
    """The sun is not in the sky's map, which would count it twice."""
    sky = sun.sun_and_sky(45, 0)
    assert np.isfinite(sky.rest).all() and sky.rest.min() >= 0
    above, below = sky.rest[:80].mean(axis=(0, 1)), sky.rest[100:].mean(axis=(0, 1))
    assert above[2] > above[1] > above[0]
    assert sky.rest.max() < 30 * sky.rest.mean()
    lit = sky.direction[1] + above.mean()  # of a white card on the ground, about
    assert below[1] == pytest.approx(0.2 * lit, rel=0.2)


def face_with(error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An albedo found, with that log error, and the true one."""
    rng = np.random.default_rng(0)
    fine = ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE, 3)), (1, 1, 0))
    true = 0.3 * np.exp(0.3 * fine)
    noise = ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE, 1)), (1, 1, 0))
    return true * np.exp(0.05 * noise + error[..., None]), true


def half() -> np.ndarray:
    """A shadow on one half."""
    visible = np.ones((SIDE, SIDE))
    visible[:, SIDE // 2 :] = 0
    return visible


def test_an_edge_of_a_shadow_left_in_the_albedo_is_seen() -> None:
    """As large as the step in it; none where the albedo has none."""
    clean = sun.edges(*face_with(np.zeros((SIDE, SIDE))), half(), ALL)
    faint, strong = (sun.edges(*face_with(s * half()), half(), ALL) for s in (0.1, 0.5))
    assert clean == pytest.approx(1, abs=0.15)
    assert 1.3 < faint < strong / 2


def test_without_shadow_there_is_no_edge() -> None:
    """Nor detail in it."""
    found, true = face_with(np.zeros((SIDE, SIDE)))
    photo = np.full((SIDE, SIDE, 3), 100, np.uint8)
    assert np.isnan(sun.edges(found, true, np.ones((SIDE, SIDE)), ALL))
    assert np.isnan(sun.detail(found, true, np.ones((SIDE, SIDE)), ALL, photo))


def test_detail_counts_where_the_photo_is_not_black() -> None:
    """All of it with the truth itself, none with something else in its place."""
    true = face_with(np.zeros((SIDE, SIDE)))[1]
    photo = np.full((SIDE, SIDE, 3), 100, np.uint8)
    assert sun.detail(3 * true, true, half(), ALL, photo) == pytest.approx(1)
    assert abs(sun.detail(true[::-1], true, half(), ALL, photo)) < 0.2
    assert np.isnan(sun.detail(true, true, half(), ALL, photo // 10))


def test_camera_keeps_order_and_clips() -> None:
    """Brighter stays brighter; what is beyond white is white, whatever the white balance."""
    ramp = np.linspace(0, 1.3, 60, dtype=np.float32)[:, None, None] * np.ones((1, 60, 3))
    stored = sun.camera(ramp.astype(np.float32)).mean(axis=1)
    assert (np.diff(stored.mean(axis=1)) > -3).all()  # JPEG ripples
    assert stored[-1] == pytest.approx([255, 255, 255], abs=3)
    grey = stored[25]
    assert grey[0] > grey[1] > grey[2]


@pytest.fixture(scope="module")
def landmarks() -> np.ndarray:
    """Of the mean head, 60 cm away."""
    from unlit.head.sources.library import default_model

    model = default_model()
    points = model.landmarks(model.neutral)
    return points - np.nanmean(points, axis=0) - np.array([0, 0, 60])


def hidden(body: dict[str, Any], points: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(N,) bool: points from which the sun is not seen."""
    scene = mi.load_dict({"type": "scene", **body})
    start = device(mi.Point3f, np.nan_to_num(points))
    return scene.ray_test(mi.Ray3f(start, mi.Vector3f(*map(float, towards)))).numpy()


def test_brim_shades_the_brows_and_not_the_chin(landmarks: np.ndarray) -> None:
    """Under a sun 45 degrees high."""
    towards = sun.sun_and_sky(45, 0).direction
    blocked = hidden(occluders.brim(landmarks, towards), landmarks, towards)
    assert blocked[[105, 334]].all()
    assert not blocked[[152, 17]].any()


@pytest.mark.parametrize("kind", ["strands", "frames", "leaves"])
def test_occluders_hide_part_of_the_sun(landmarks: np.ndarray, kind: str) -> None:
    """From some of the face, and from less than half of it."""
    towards = sun.sun_and_sky(45, 45).direction
    beside = np.stack(np.meshgrid([-0.4, 0, 0.4], [-0.4, 0, 0.4], [0]), axis=-1).reshape(-1, 1, 3)
    points = (landmarks + beside).reshape(-1, 3)
    share = hidden(occluders.KINDS[kind](landmarks, towards), points, towards).mean()
    assert 0.005 < share < 0.5
