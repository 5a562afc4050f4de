"""The overview shows each thing in its place, the right way round."""

import io

import numpy as np
import pytest
from PIL import Image

from changed import changed
from unlit.output.images import encoded
from unlit.output.montage import clay, error, light, montage, preview_png
from unlit.output.relit import outdoors
from unlit.scene.light import SphericalGaussians


@pytest.mark.usefixtures("no_relight")
def test_tiles_are_in_their_places(face):
    """Twelve squares of 320 pixels: photo first, the albedo below it."""
    sheet = montage(face)
    assert sheet.shape == (8 + 3 * 352, 8 + 4 * 328, 3)
    for row, image in (
        (0, face.photo.image),
        (1, face.face.maps.diffuse_albedo * (face.face.mask[..., None] > 0)),
    ):
        tile = sheet[32 + row * 352 :][:320, 8:328].reshape(32, 10, 32, 10, 3).mean(axis=(1, 3))
        assert np.abs(tile - encoded(image)).mean() < 3


def test_error_is_four_times_the_encoded_difference(face):
    """Black for a perfect render and outside the mask."""
    assert not error(changed(face, {"images.render": face.photo.image})).any()
    black = changed(face, {"images.render": np.zeros_like(face.photo.image)})
    inside = face.face.mask > 0
    expected = np.minimum(4 * encoded(face.photo.image)[inside].astype(int), 255)
    assert np.abs(error(black)[inside] - expected).max() <= 2
    assert not error(black)[~inside].any()


def test_light_from_the_photos_right_is_shown_right(face):
    """One lobe along +x, which is right in the photo: map, matte and mirror ball agree."""
    lobe = SphericalGaussians(np.array([[1, 0, 0]], "f4"), np.array([9], "f4"), np.array([5], "f4"))
    picture = light(changed(face, {"light": lobe})).astype(int)
    side = len(picture)
    map_, matte, mirror = (
        picture[: side // 2],
        picture[side // 2 :, : side // 2],
        picture[side // 2 :, side // 2 :],
    )
    for part in (map_, matte, mirror):
        half = part.shape[1] // 2
        assert part[:, half:].mean() > part[:, :half].mean() + 20


def test_clay_shows_the_mesh_where_the_camera_sees_it(face):
    """The ball's outline, brighter above than below."""
    picture = clay(face).astype(int)
    inside = face.face.mask > 0
    assert (picture[inside] != picture[0, 0]).mean() > 0.97
    assert picture[:16][inside[:16]].mean() > picture[16:][inside[16:]].mean() + 20


def test_the_sky_is_above_and_blue():
    """Row 0 of the map is up."""
    sky = outdoors()
    assert sky.shape == (180, 360, 3)
    assert sky[0].mean() > 2 * sky[-1].mean()
    assert (sky[0, :, 2] > sky[0, :, 0]).all()


def test_montage_relights_for_real(face):
    """The side light comes from the right, and differs from the flash."""
    waist = face.face.mesh.vertices.copy()
    ring = np.abs(waist[:, 1]) < 1
    waist[ring, 0] *= 0.8  # a furrow, in which light bounces
    sheet = montage(changed(face, {"face.mesh.vertices": waist})).astype(int)
    flash, side = (sheet[32 + 2 * 352 :][:320, 8 + k * 328 :][:, :320] for k in (1, 2))
    assert side[:, 160:].mean() > 2 * side[:, :160].mean() > 0
    assert 0.5 < flash[:, 160:].mean() / flash[:, :160].mean() < 2


def test_preview_works_before_there_is_a_render(face):
    """After the fit nothing has been shaded yet."""
    zero = np.zeros_like(face.images.render)
    early = changed(face, {"images.render": zero, "images.diffuse_shading": zero})
    assert Image.open(io.BytesIO(preview_png(early))).size == (8 + 3 * 264, 8 + 2 * 288)
