"""The gain between albedo and light, pinned by what is known."""

import numpy as np
import pytest
from PIL import Image

from unlit.errors import SettingsError
from unlit.face.conditions import Conditions, Shadow
from unlit.face.gain import AlbedoGain, check_exposure, largest_gain, peak_luminance
from unlit.face.photo import FacePhoto
from unlit.perception.regions import Regions
from unlit.photo.crop import Crop
from unlit.photo.photo import white_luminance_from_exif
from unlit.scene.camera import Camera
from unlit.settings.conditions import KnownExposure

_TIME, _F_NUMBER, _SPEED = 0x829A, 0x829D, 0x8827


def photo(
    size: int, skin: np.ndarray | float = 1.0, white: float | None = None, crop: Crop | None = None
) -> FacePhoto:
    """A black photo of skin, as far as it says."""
    weights = np.zeros((size, size, 6), np.float32)
    weights[..., 0], weights[..., 5] = skin, 1 - skin
    camera = Camera(size, size, 2.0 * size, size / 2, size / 2)
    crop = crop or Crop(np.eye(2, 3), size)
    image = np.zeros((size, size, 3), np.float32)
    return FacePhoto("a.png", image, camera, crop, Regions(weights), np.zeros((5, 3)), white)


def test_a_patch_is_where_the_photo_has_it():
    """The crop is twice as fine as the photo and begins at its pixel (10, 20)."""
    crop = Crop(np.array([[2.0, 0, -20], [0, 2.0, -40]]), 200)
    inside = np.zeros((200, 200), dtype=bool)
    inside[:100] = True
    seen = photo(200, inside.astype(np.float32), crop=crop)
    rows, columns = np.nonzero(
        AlbedoGain(KnownExposure("40,50=0.3"), seen, Conditions()).patch(inside)
    )
    assert (rows.mean() + 0.5, columns.mean() + 0.5) == pytest.approx((60, 60))
    assert len(rows) < 20
    with pytest.raises(SettingsError, match="40,90"):
        AlbedoGain(KnownExposure("40,90=0.3"), seen, Conditions()).patch(inside)


def test_no_albedo_is_measured_off_the_skin_or_where_it_is_filled_in():
    """Without a pixel, all bare skin is the patch."""
    skin = np.zeros((20, 20), np.float32)
    skin[5:15] = 1
    trust = np.ones((20, 20), np.float32)
    trust[:8] = 0
    shadow = Shadow(trust, np.ones((20, 20, 3), np.float32), trust)
    everywhere = np.ones((20, 20), bool)
    for known in (KnownExposure("auto"), KnownExposure("skin=0.3"), KnownExposure("500lux")):
        found = AlbedoGain(known, photo(20, skin, 1.0), Conditions(shadow=shadow))
        assert np.unique(np.nonzero(found.patch(everywhere))[0]).tolist() == list(range(8, 15))
    bare = photo(20, 0 * skin)
    with pytest.raises(SettingsError, match="no bare skin"):
        AlbedoGain(KnownExposure("skin=0.3"), bare, Conditions()).patch(everywhere)
    assert not AlbedoGain(KnownExposure("auto"), bare, Conditions()).patch(everywhere).any()


def test_the_gains():
    """Grey skin of 0.2 that is known to be 0.4; 500 lux said of a photo of 1,000."""
    grey, inside = np.full((8, 8, 3), 0.2, np.float32), np.ones((8, 8), bool)
    for known in (KnownExposure("skin=0.4"), KnownExposure("4,4=0.4")):
        said = AlbedoGain(known, photo(8), Conditions())
        assert said.during_stages(grey, inside) == pytest.approx(2)
        assert said.of_result(grey, 7 * grey, inside) == pytest.approx(2)
    # 1,000 lux give a white Lambertian card 1,000 / pi cd/m^2.
    measured = AlbedoGain(KnownExposure("500lux"), photo(8, white=2000 / np.pi), Conditions())
    half = np.full((8, 8, 3), 0.5, np.float32)
    assert measured.of_result(grey, half, inside) == pytest.approx(2)
    assert measured.during_stages(grey, inside) == pytest.approx(4)  # there E = 1
    # Within an albedo of 1, as any factor may have been said.
    assert measured.during_stages(4 * grey, inside) == pytest.approx(1 / 0.8)


def test_the_lights_colour_is_in_the_illuminance():
    """A lamp of half the luminance gives half the lux, so twice as much remains for albedo."""
    grey, inside = np.full((8, 8, 3), 0.2, np.float32), np.ones((8, 8), bool)
    seen = photo(8, white=2000 / np.pi)
    lamps = [Conditions(np.full(3, level, np.float32)) for level in (1.0, 0.5)]
    white, half = (AlbedoGain(KnownExposure("1000lux"), seen, lamp) for lamp in lamps)
    for of in (AlbedoGain.of_result, lambda gain, a, _, i: gain.during_stages(a, i)):
        assert of(white, grey, 5 * grey, inside) == pytest.approx(2)
        assert of(half, grey, 5 * grey, inside) == pytest.approx(1)


def test_lux_need_a_photo_that_tells_its_exposure():
    with pytest.raises(SettingsError, match="500lux"):
        check_exposure(KnownExposure("500lux"), None)
    with pytest.raises(SettingsError, match="500lux"):
        AlbedoGain(KnownExposure("500lux"), photo(8), Conditions())


def test_full_light_is_the_luminance_of_the_best_lit():
    e = np.concatenate([np.full((98, 3), 0.2), np.full((4, 3), (1.0, 0.5, 0.25))])
    assert peak_luminance(e) == pytest.approx(0.2126 + 0.3576 + 0.01805, rel=1e-3)


def test_sunny_16():
    """By that rule f/16 and 1 / ISO seconds suit full sun, 80,000 to 120,000 lux.

    There a white card is within half a stop of the brightest that the file can hold.
    """
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({_TIME: 1 / 100, _F_NUMBER: 16.0, _SPEED: (100, 0)})
    white = white_luminance_from_exif(exif)
    assert white is not None
    assert 80_000 / np.sqrt(2) < np.pi * white < 120_000 * np.sqrt(2)
    exif.get_ifd(0x8769).update({_TIME: 1 / 200})
    assert white_luminance_from_exif(exif) == pytest.approx(2 * white)


@pytest.mark.parametrize(
    "spoilt", [{_SPEED: 0}, {_SPEED: ()}, {_TIME: float("inf")}, {_F_NUMBER: "x"}]
)
def test_without_all_three_there_is_no_unit(spoilt):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({_TIME: 0.01, _F_NUMBER: 4.0, _SPEED: 100} | spoilt)
    assert white_luminance_from_exif(exif) is None


def test_albedo_stays_within_one():
    """By its largest channel; a stray pixel does not darken the face."""
    albedo, inside = np.full((5000, 3), (0.8, 0.5, 0.4)), np.ones(5000, bool)
    albedo[0] = 3
    assert largest_gain(albedo) == pytest.approx(1.25)
    assert AlbedoGain().during_stages(albedo, inside) == 0.7
    albedo[:50] = (1.5, 0.8, 0.7)
    assert largest_gain(albedo) == pytest.approx(1 / 1.5)
    for found in (AlbedoGain(), AlbedoGain(KnownExposure("auto"), photo(8), Conditions())):
        assert found.during_stages(albedo, inside) == largest_gain(albedo)
        assert found.of_result(albedo, albedo, inside) == largest_gain(albedo)
