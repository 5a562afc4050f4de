"""Colours of light: against the CIE's tables, and from cards painted into photos."""

import numpy as np
import pytest

from unlit.color import WHITE, decode_srgb
from unlit.conditions.illuminant import (
    fitting,
    of_card,
    of_temperature,
    stated,
    temperature,
)
from unlit.errors import SettingsError
from unlit.photo.photo import Photo
from unlit.settings.conditions import LightColorRequest

SRGB_TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)


@pytest.mark.parametrize(
    ("kelvin", "xy"),
    [
        (2856, (0.4476, 0.4074)),  # A
        (5003, (0.3457, 0.3585)),  # D50
        (5503, (0.3324, 0.3474)),  # D55
        (6504, (0.3127, 0.3290)),  # D65
        (7504, (0.2990, 0.3149)),  # D75
        (2500, (0.4770, 0.4137)),  # black bodies
        (3000, (0.4369, 0.4041)),
    ],
)
def test_temperatures_have_the_chromaticities_of_the_cie(kelvin, xy):
    xyz = SRGB_TO_XYZ @ of_temperature(kelvin)
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), xy, atol=0.001)


def test_between_4000_and_5000_kelvin_there_is_no_step():
    steps = [np.log(of_temperature(k)) for k in range(3900, 5101, 10)]
    assert np.abs(np.diff(steps, axis=0)).max() < 0.01


@pytest.mark.parametrize("kelvin", [1800, 2700, 4500, 6500, 12000])
def test_a_temperature_is_found_again(kelvin):
    assert temperature(of_temperature(kelvin)) == pytest.approx(kelvin, rel=0.02)


def test_what_is_told():
    assert stated(LightColorRequest("auto")) is None
    assert stated(LightColorRequest("12,30")) is None
    for text, color in {
        "white": WHITE,
        "2,1,0.5": (1, 0.5, 0.25),
        "#ffb46b": decode_srgb([1, 180 / 255, 107 / 255]),
        "2700K": of_temperature(2700),
    }.items():
        found = stated(LightColorRequest(text))
        assert found is not None and found.dtype == np.float32
        np.testing.assert_array_equal(found, np.float32(color))


def test_no_good_value_of_the_face_becomes_saturated():
    """Red skin under a blue lamp: red, at 0.8, was 0.8 / 0.5 = 1.6 times white."""
    lamp = np.array([0.5, 0.7, 1.0], np.float32)
    face = np.full((50, 3), (0.8, 0.5, 0.5), np.float32)
    raised = fitting(lamp, face)
    np.testing.assert_allclose(raised, 1.6 * lamp)
    np.testing.assert_array_equal(fitting(lamp, face / 2), lamp)
    assert fitting(WHITE, 3 * face) is WHITE


def photo_with_card():
    """Dark noise, and a card of 20 pixels whose middle is at (70, 40)."""
    pixels = np.random.default_rng(0).uniform(0.05, 0.1, (100, 200, 3))
    pixels[30:50, 60:80] = (0.4, 0.2, 0.1)
    pixels[40, 70] = 1.0  # dust
    pixels[:20, :20] = 1.0
    return Photo.of(pixels, "card.png")


def test_a_card_gives_the_lights_colour():
    np.testing.assert_allclose(of_card(photo_with_card(), (70, 40)), (1, 0.5, 0.25), rtol=1e-6)


@pytest.mark.parametrize(("xy", "word"), [((300, 4), "outside"), ((5, 5), "too bright")])
def test_a_card_that_cannot_be_read(xy, word):
    with pytest.raises(SettingsError, match=word):
        of_card(photo_with_card(), xy)
