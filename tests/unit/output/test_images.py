"""EXR keeps every bit; previews have the ranges that are documented."""

import io

import numpy as np
from PIL import Image

from unlit.machine.runtime import mitsuba
from unlit.output import images


def test_exr_keeps_every_bit(tmp_path):
    """Negative, tiny and large float32 values, one and three channels, come back the same."""
    mi = mitsuba()
    random = np.random.default_rng(1)
    for shape in ((5, 7), (5, 7, 3)):
        image = (random.normal(size=shape) * 10.0 ** random.integers(-30, 30, shape)).astype("f4")
        (tmp_path / "a.exr").write_bytes(images.exr(image))
        read = np.array(mi.Bitmap(str(tmp_path / "a.exr"))).reshape(shape)
        assert read.dtype == np.float32
        np.testing.assert_array_equal(read, image)


def test_png_keeps_every_byte():
    """Grey and colour."""
    for shape in ((4, 5), (4, 5, 3)):
        image = np.random.default_rng(2).integers(0, 256, shape, dtype=np.uint8)
        np.testing.assert_array_equal(Image.open(io.BytesIO(images.png(image))), image)


def test_previews_have_the_documented_ranges(face):
    """Linear sRGB 0.3 is encoded 148.9 / 255; a normal along z is (128, 128, 255)."""
    assert images.encoded(np.array([0, 0.3, 1, 7, -1, np.nan])).tolist() == [0, 149, 255, 255, 0, 0]
    assert images.normals(np.array([[0, 0, 1.0], [-1, 0, 0], [0, 0, 0]])).tolist() == [
        [128, 128, 255],
        [0, 128, 128],
        [0, 0, 0],
    ]
    array, look = images.MAPS["specular_albedo"]
    assert (look(array(face)) == round(0.9 / 2 * 255)).all()


def test_tone_mapping_is_monotonic_and_survives_darkness():
    """Brighter stays brighter far above white; a black light is black, not NaN."""
    ramp = images.tone_mapped(np.array([[0, 0.1, 1, 10.0]]))[0].astype(int)
    assert (np.diff(ramp) > 0).all()
    assert (images.tone_mapped(np.zeros((2, 2))) == 0).all()
