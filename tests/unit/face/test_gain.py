"""The gain between albedo and light, pinned by what is known."""

import numpy as np
import pytest
from PIL import Image

from unlit.errors import SettingsError
from unlit.face.gain import (
    check_unit,
    conventional_gain,
    full_light,
    gain,
    patch,
    within_one,
)
from unlit.photo.crop import Crop
from unlit.photo.photo import unit_from_exif
from unlit.settings.conditions import KnownExposure

_TIME, _F_NUMBER, _SPEED = 0x829A, 0x829D, 0x8827


def test_a_patch_is_where_the_photo_has_it():
    """The crop is twice as fine as the photo and begins at its pixel (10, 20)."""
    crop = Crop(np.array([[2.0, 0, -20], [0, 2.0, -40]]), 200)
    inside = np.zeros((200, 200), dtype=bool)
    inside[:100] = True
    rows, columns = np.nonzero(patch(KnownExposure("40,50=0.3"), crop, inside, inside))
    assert (rows.mean() + 0.5, columns.mean() + 0.5) == pytest.approx((60, 60))
    assert len(rows) < 20
    with pytest.raises(SettingsError, match="40,90"):
        patch(KnownExposure("40,90=0.3"), crop, inside, inside)


def test_the_gains():
    """A grey patch of 0.2 that is known to be 0.4; a card of 500 lux under a photo of 1,000."""
    grey = np.full((5, 3), 0.2, np.float32)
    assert gain(KnownExposure("skin=0.4"), grey, 1.0, None) == pytest.approx(2)
    # 1,000 lux give a white Lambertian card 1,000 / pi cd/m^2.
    assert gain(KnownExposure("500lux"), grey, 0.5, 2000 / np.pi) == pytest.approx(2)
    with pytest.raises(ValueError, match="neither"):
        gain(KnownExposure("500lux"), grey, 0.5, None)
    with pytest.raises(SettingsError, match="500lux"):
        check_unit(KnownExposure("500lux"), None)


def test_full_light_is_the_luminance_of_the_best_lit():
    e = np.concatenate([np.full((98, 3), 0.2), np.full((4, 3), (1.0, 0.5, 0.25))])
    assert full_light(e) == pytest.approx(0.2126 + 0.3576 + 0.01805, rel=1e-3)


def test_sunny_16():
    """By that rule f/16 and 1 / ISO seconds suit full sun, 80,000 to 120,000 lux.

    There a white card is within half a stop of the brightest that the file can hold.
    """
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({_TIME: 1 / 100, _F_NUMBER: 16.0, _SPEED: (100, 0)})
    unit = unit_from_exif(exif)
    assert unit is not None
    assert 80_000 / np.sqrt(2) < np.pi * unit < 120_000 * np.sqrt(2)
    exif.get_ifd(0x8769).update({_TIME: 1 / 200})
    assert unit_from_exif(exif) == pytest.approx(2 * unit)


@pytest.mark.parametrize(
    "spoilt", [{_SPEED: 0}, {_SPEED: ()}, {_TIME: float("inf")}, {_F_NUMBER: "x"}]
)
def test_without_all_three_there_is_no_unit(spoilt):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({_TIME: 0.01, _F_NUMBER: 4.0, _SPEED: 100} | spoilt)
    assert unit_from_exif(exif) is None


def test_albedo_stays_within_one():
    """By its largest channel; a stray pixel does not darken the face."""
    albedo = np.full((5000, 3), (0.8, 0.5, 0.4))
    albedo[0] = 3
    assert within_one(albedo) == pytest.approx(1.25)
    assert conventional_gain(albedo) == 0.7
    albedo[:50] = (1.5, 0.8, 0.7)
    assert within_one(albedo) == conventional_gain(albedo) == pytest.approx(1 / 1.5)
