"""Warnings: each appears for what it is about and for nothing else."""

import numpy as np
import pytest

from changed import changed, part
from drawn_face import SIZE as DRAWN
from drawn_face import drawn_landmarks
from report_head import report_head
from unlit.face.conditions import Shadow
from unlit.face.warnings import warnings
from unlit.perception.parser import CLASSES, SIZE
from unlit.perception.topology import LEFT_EYE
from unlit.photo.crop import Crop
from unlit.settings.conditions import LightColorRequest
from unlit.settings.settings import Settings


@pytest.fixture(scope="module")
def face():
    return report_head()


IMAGE, ALBEDO = "photo.image", "face.maps.diffuse_albedo"


def spoilt(face, share, place, value):
    """The face with `share` of the measured pixels of one image set to a value."""
    inside = np.flatnonzero(face.face.mask.ravel() > 0)
    some = inside[: round(share * len(inside))]
    pixels = part(face, place).copy()
    pixels.reshape(-1, 3)[some] = value
    return changed(face, {place: pixels})


def test_a_good_photo_has_none(face):
    assert warnings(face) == ()


@pytest.mark.parametrize(
    ("place", "value", "share", "word"),
    [
        ("images.diffuse_shading", 0.05, 0.25, "Shadowed: 25%"),
        (IMAGE, 1.0, 0.03, "Saturated: 3.0%"),
        (IMAGE, 0.0, 0.03, "Clipped: 3.0% of the face is black"),
        (ALBEDO, 1.1, 0.03, "Bright: the diffuse albedo of 3.0%"),
    ],
)
def test_each_names_its_share(face, place, value, share, word):
    (sentence,) = warnings(spoilt(face, share, place, value))
    assert sentence.startswith(word)


def test_a_sun_says_where_it_stands(face):
    inside = face.face.mask > 0
    visibility = np.where(np.cumsum(inside).reshape(inside.shape) < 0.2 * inside.sum(), 0, 1)
    remaining = np.ones((*inside.shape, 3), np.float32)
    direction = np.array([-0.5, 0.5**0.5, 0.5], np.float32)
    sun = Shadow(visibility.astype(np.float32), remaining, remaining[..., 0], direction)
    (sentence,) = warnings(changed(face, {"conditions.shadow": sun}))
    assert "45 degrees up and 45 to the left" in sentence
    assert "20% of the face" in sentence


def test_a_cast_shadow_names_its_share(face):
    inside = face.face.mask > 0
    visibility = np.where(np.cumsum(inside).reshape(inside.shape) < 0.2 * inside.sum(), 0, 1)
    remaining = np.ones((*inside.shape, 3), np.float32)
    shadow = Shadow(visibility.astype(np.float32), remaining, remaining[..., 0])
    (sentence,) = warnings(changed(face, {"conditions.shadow": shadow}))
    assert sentence.startswith("Cast shadow: 20% of the face")


def test_a_tint_says_how_strong_it_is(face):
    warm = (np.cumsum(face.face.mask > 0).reshape(face.face.mask.shape) % 2).astype(np.float32)
    tint = np.dstack([1 + 0.5 * warm, np.ones_like(warm), np.ones_like(warm)])
    (sentence,) = warnings(changed(face, {"conditions.tint": tint}))
    assert sentence.startswith("Tint: ") and "by 50%" in sentence and "tint.mode=never" in sentence


def test_an_albedo_at_its_bound_is_seen_behind_the_gain(face):
    """What was lowered to 1 at the end may have stopped at the stages' bound."""
    lowered = changed(spoilt(face, 0.03, ALBEDO, 1.0), {"gain": 1 / Settings().max_diffuse})
    (sentence,) = warnings(lowered)
    assert sentence.startswith("Clipped: the diffuse albedo of 3.0%")


def test_one_bright_channel_is_saturated_but_one_dark_is_not_clipped(face):
    (sentence,) = warnings(spoilt(face, 0.1, IMAGE, (1.0, 0.3, 0.3)))
    assert sentence.startswith("Saturated")
    assert warnings(spoilt(face, 0.1, IMAGE, (0.5, 0.3, 0.0))) == ()


def test_a_small_face_is_told_in_pixels_of_the_photo(face):
    columns = np.flatnonzero((face.face.mask > 0).any(axis=0))
    width = (columns[-1] - columns[0] + 1) / 3
    crop = Crop(np.array([[3.0, 0, 0], [0, 3.0, 0]]), face.photo.crop.resolution)
    (sentence,) = warnings(changed(face, {"photo.crop": crop}))
    assert f"some {width:.0f} pixels wide" in sentence
    assert "3.0 times" in sentence
    crop = Crop(np.array([[1.05, 0, 0], [0, 1.05, 0]]), face.photo.crop.resolution)
    assert warnings(changed(face, {"photo.crop": crop})) == ()


@pytest.mark.parametrize(("residual", "count"), [(0.03, 0), (0.09, 1), (None, 0)])
def test_the_residual_of_the_landmarks(face, residual, count):
    assert len(warnings(changed(face, {"head.landmark_residual": residual}))) == count


def test_nothing_measured_does_not_fail(face):
    (sentence,) = warnings(changed(face, {"face.mask": np.zeros_like(face.face.mask)}))
    assert "No pixel" in sentence


def test_skin_is_no_grey_card(face):
    """A card's pixel on the face is warned of, one beside it is not."""
    row, column = np.argwhere(face.face.mask > 0.5).mean(axis=0).astype(int)
    x, y = face.photo.crop.inverse_points((column + 0.5, row + 0.5))
    (sentence,) = warnings(changed(face, {"settings.light_color": LightColorRequest(f"{x},{y}")}))
    assert sentence.startswith("Grey card")
    assert warnings(changed(face, {"settings.light_color": LightColorRequest("0,0")})) == ()


def test_what_covers_the_face_is_named(face):
    """Tinted glasses over the eyes; on the same face of nothing but skin, nothing is told."""
    drawn = drawn_landmarks()
    landmarks = np.column_stack([drawn, np.zeros(len(drawn))]) * (len(face.face.mask) / DRAWN)
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("skin")] = 1
    bare = {"photo.landmarks": landmarks, "photo.regions.shares": shares}
    assert warnings(changed(face, bare)) == ()
    eyes = landmarks[list(LEFT_EYE), 1].mean() * SIZE / len(face.face.mask)
    worn = np.zeros_like(shares)
    worn[..., CLASSES.index("tinted lens")] = np.abs(np.arange(SIZE) - eyes)[:, None] < 12
    (sentence,) = warnings(changed(face, bare | {"photo.regions.shares": worn}))
    assert sentence.startswith("Tinted glasses: the eyes")
