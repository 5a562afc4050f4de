"""Warnings: each appears for what it is about and for nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from report_head import report_head
from unlit.face.warnings import findings
from unlit.photo.crop import Crop
from unlit.settings.settings import Settings


@pytest.fixture(scope="module")
def face():
    return report_head()


def spoilt(face, share, **images):
    """The face with `share` of its measured pixels set to a value, by map."""
    inside = np.flatnonzero(face.mask.ravel() > 0)
    some = inside[: round(share * len(inside))]
    changed = {}
    for name, value in images.items():
        pixels = getattr(face, name).copy()
        pixels.reshape(-1, 3)[some] = value
        changed[name] = pixels
    return replace(face, **changed)


def test_a_good_photo_has_none(face):
    assert findings(face) == []


@pytest.mark.parametrize(
    ("images", "share", "word"),
    [
        ({"diffuse_shading": 0.05}, 0.25, "Shadowed: 25%"),
        ({"image": 1.0}, 0.03, "Saturated: 3.0%"),
        ({"image": 0.0}, 0.03, "Clipped: 3.0% of the face is black"),
        ({"diffuse_albedo": 1.1}, 0.03, "Bright: the diffuse albedo of 3.0%"),
    ],
)
def test_each_names_its_share(face, images, share, word):
    (sentence,) = findings(spoilt(face, share, **images))
    assert sentence.startswith(word)


def test_a_cast_shadow_names_its_share(face):
    inside = face.mask > 0
    lit = np.where(np.cumsum(inside).reshape(inside.shape) < 0.2 * inside.sum(), 0, 1)
    (sentence,) = findings(replace(face, lit=lit.astype(np.float32)))
    assert sentence.startswith("Cast shadow: 20% of the face")


def test_an_albedo_at_its_bound_is_seen_behind_the_gain(face):
    """What was lowered to 1 at the end may have stopped at the stages' bound."""
    lowered = replace(spoilt(face, 0.03, diffuse_albedo=1.0), gain=1 / Settings().max_diffuse)
    (sentence,) = findings(lowered)
    assert sentence.startswith("Clipped: the diffuse albedo of 3.0%")


def test_one_bright_channel_is_saturated_but_one_dark_is_not_clipped(face):
    (sentence,) = findings(spoilt(face, 0.1, image=(1.0, 0.3, 0.3)))
    assert sentence.startswith("Saturated")
    assert findings(spoilt(face, 0.1, image=(0.5, 0.3, 0.0))) == []


def test_a_small_face_is_told_in_pixels_of_the_photo(face):
    columns = np.flatnonzero((face.mask > 0).any(axis=0))
    width = (columns[-1] - columns[0] + 1) / 3
    crop = Crop(np.array([[3.0, 0, 0], [0, 3.0, 0]]), face.crop.resolution)
    (sentence,) = findings(replace(face, crop=crop))
    assert f"some {width:.0f} pixels wide" in sentence
    assert "3.0 times" in sentence
    crop = Crop(np.array([[1.05, 0, 0], [0, 1.05, 0]]), face.crop.resolution)
    assert findings(replace(face, crop=crop)) == []


@pytest.mark.parametrize(("residual", "count"), [(0.03, 0), (0.09, 1), (None, 0), ("x", 0)])
def test_the_residual_of_the_landmarks(face, residual, count):
    assert len(findings(replace(face, metrics={"landmark_residual": residual}))) == count


def test_nothing_measured_does_not_fail(face):
    (sentence,) = findings(replace(face, mask=np.zeros_like(face.mask)))
    assert "No pixel" in sentence


def test_skin_is_no_grey_card(face):
    """A card's pixel on the face is warned of, one beside it is not."""
    row, column = np.argwhere(face.mask > 0.5).mean(axis=0).astype(int)
    x, y = face.crop.inverse_points((column + 0.5, row + 0.5))
    (sentence,) = findings(replace(face, settings=face.settings | {"light_color": f"{x},{y}"}))
    assert sentence.startswith("Grey card")
    assert findings(replace(face, settings=face.settings | {"light_color": "0,0"})) == []
