"""What can be said of the light's colour and of the exposure."""

import pytest

from unlit.errors import SettingsError
from unlit.settings.conditions import KnownExposure, LightColorRequest


def test_light_colors() -> None:
    """One of the three is known, or none."""
    assert LightColorRequest(" White").rgb == (1, 1, 1)
    nothing = LightColorRequest("auto")
    assert (nothing.rgb, nothing.kelvin, nothing.card) == (None, None, None)
    card = LightColorRequest(" 1200, 340.5 ")
    assert (card.rgb, card.kelvin, card.card) == (None, None, (1200, 340.5))
    assert LightColorRequest("4,2,1").rgb == (4, 2, 1)
    assert LightColorRequest("#ffffff").rgb == (1, 1, 1)
    assert LightColorRequest("2700 k") == LightColorRequest("2700K") != nothing
    for end in (1700, 25000):
        assert LightColorRequest(f"{end}K").kelvin == end


@pytest.mark.parametrize(
    "text",
    [
        *("", "warm", "270K", "1e9K", "1699.9K", "25001K", "1,2,3,4", "1,0,1", "1,nan,1", "#12"),
        *("-1,5", "0,0,0", "255,180,107", "#000000", "#ff0000", "9" * 400 + ",1,1", "inf,1,1"),
    ],
)
def test_light_colors_that_cannot_be(text: str) -> None:
    """One line."""
    with pytest.raises(SettingsError) as caught:
        LightColorRequest(text)
    assert str(caught.value).startswith("light_color")
    assert "\n" not in str(caught.value)


def test_exposures() -> None:
    """An albedo of the skin or of a patch, or an illuminance."""
    nothing = KnownExposure("auto")
    assert (nothing.albedo, nothing.at, nothing.lux) == (None, None, None)
    assert KnownExposure("skin=0.35").albedo == 0.35
    patch = KnownExposure(" 812, 640.5 = 0.2 ")
    assert (patch.albedo, patch.at) == (0.2, (812, 640.5))
    assert KnownExposure("500 lux").lux == 500


@pytest.mark.parametrize(
    "text",
    ["", "0.35", "skin=0", "skin=1.5", "0lux", "1,2=", "face=0.3", "9" * 400 + "lux"],
)
def test_exposures_that_cannot_be(text: str) -> None:
    """One line."""
    with pytest.raises(SettingsError) as caught:
        KnownExposure(text)
    assert str(caught.value).startswith("exposure")
    assert "\n" not in str(caught.value)
