"""The yardsticks of the regions, on shapes and colours of known size."""

from __future__ import annotations

import numpy as np
import pytest

from drawn_face import HIGH, MIDDLE, SIZE, WIDE, drawn_landmarks
from unlit.perception.measures import (
    colours,
    disk,
    face_area,
    face_size,
    smoothstep,
    upwards,
)


def test_size_and_upright_follow_the_face() -> None:
    """The root of the oval's area; from chin to hairline, whichever way the head is rolled."""
    landmarks = drawn_landmarks()
    assert face_size(landmarks) == pytest.approx(np.sqrt(np.pi * WIDE * HIGH), rel=0.01)
    np.testing.assert_allclose(upwards(landmarks), (0, -1))
    quarter = landmarks @ np.array([[0, 1], [-1, 0]]).T  # x, y -> y, -x
    np.testing.assert_allclose(upwards(quarter), (-1, 0), atol=1e-12)
    assert face_size(2 * landmarks) == pytest.approx(2 * face_size(landmarks))


def test_the_area_of_a_face_has_its_forehead() -> None:
    """The oval, and above its top three tenths of the face's height, which is two half axes."""
    area = face_area(drawn_landmarks(), SIZE)
    x, y = MIDDLE.astype(int)
    assert area[y, x] and area[round(y + HIGH) - 3, x] and not area[round(y + HIGH) + 3, x]
    assert not area[y, round(x + WIDE) + 3]
    column = np.flatnonzero(area[:, x])
    assert column[0] == pytest.approx(max(y - HIGH - 0.3 * 2 * HIGH, 0), abs=3)


def test_smoothstep_is_flat_outside_and_rises_inside() -> None:
    """0 and 1 at the limits and beyond, a half in the middle."""
    np.testing.assert_allclose(smoothstep(np.array([0, 2, 3, 4, 9.0]), 2, 4), (0, 0, 0.5, 1, 1))


def test_light_changes_the_last_colour_only() -> None:
    """Half of the light: log-chromaticity stays, log-luminance falls by log 2."""
    image = np.tile(np.array([0.8, 0.4, 0.2], np.float32), (3, 3, 1))
    change = colours(image / 2) - colours(image)
    np.testing.assert_allclose(change[..., 2], -np.log(2), atol=0.02)
    assert np.abs(change[..., :2]).max() < 0.02
    np.testing.assert_allclose(colours(image)[..., 0], np.log(0.804 / 0.404), rtol=1e-5)


@pytest.mark.parametrize(("radius", "side"), [(0.2, 3), (1.0, 3), (4.4, 9)])
def test_disk_has_the_radius(radius: float, side: int) -> None:
    """Odd, round, at least three wide."""
    shape = disk(radius)
    assert shape.shape == (side, side) and shape[side // 2].all() and not shape[0].all()
