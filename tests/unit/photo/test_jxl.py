"""jxl.py: JPEG XL of 8 bits is read to the last one; of more bits it is refused."""

import io
import sys

import numpy as np
import pytest
from PIL import Image

from unlit.color import decode_srgb
from unlit.errors import PhotoError
from unlit.photo.jxl import read_header
from unlit.photo.photo import read_photo

CONTAINER = bytes.fromhex("0000000c4a584c200d0a870a 00000014667479706a786c20000000006a786c20")


def stream(*fields):
    """A codestream's beginning of (value, bits), lowest bits first."""
    number, at = 0, 0
    for value, count in fields:
        number |= value << at
        at += count
    return b"\xff\x0a" + number.to_bytes((at + 7) // 8, "little") + bytes(4)


def jxl(image, **options):
    pytest.importorskip("pillow_jxl")
    out = io.BytesIO()
    image.save(out, "JXL", **options)
    return out.getvalue()


def read(tmp_path, data):
    (tmp_path / "photo.jxl").write_bytes(data)
    return read_photo(tmp_path / "photo.jxl")


def picture(channels=3):
    y, x = np.mgrid[0:70, 0:96]
    pixels = np.stack([x, y, x + y, 2 * x], axis=-1)[..., :channels].astype(np.uint8)
    return Image.fromarray(pixels if channels > 1 else pixels[..., 0])


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_lossless_to_the_bit(tmp_path, channels):
    """Grey, colour, colour with alpha."""
    image = picture(channels)
    photo = read(tmp_path, jxl(image, lossless=True))
    stored = np.asarray(image.convert("RGB"))
    np.testing.assert_allclose(photo.pixels, decode_srgb(stored / 255), atol=1e-5)
    assert (photo.alpha is not None) == (channels == 4)


def test_a_jpeg_in_new_clothes_is_turned_upright(tmp_path):
    """It comes as it was; otherwise the file's own turn has been applied, whatever EXIF repeats."""
    exif = Image.Exif()
    exif[274] = 6
    picture().save(tmp_path / "x.jpg", exif=exif)
    with Image.open(tmp_path / "x.jpg") as image:
        again = jxl(image, lossless_jpeg=True)
    photo = read(tmp_path, again)
    wanted = read_photo(tmp_path / "x.jpg")
    assert photo.pixels.shape == (96, 70, 3)
    np.testing.assert_array_equal(photo.pixels, wanted.pixels)
    assert read(tmp_path, jxl(picture(), exif=exif.tobytes())).pixels.shape == (70, 96, 3)


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        ([(1, 1), (8, 5), (0, 3), (11, 5), (1, 1)], (96, 72, 8, True)),
        ([(1, 1), (9, 5), (7, 3), (1, 1)], (160, 80, 8, True)),
        ([(0, 1), (0, 2), (69, 9), (0, 3), (1, 2), (4999, 13), (1, 1)], (5000, 70, 8, True)),
        ([(1, 1), (9, 5), (1, 3), (0, 1), (0, 1), (0, 1), (1, 2)], (80, 80, 10, True)),
        ([(1, 1), (9, 5), (1, 3), (0, 1), (0, 1), (0, 1), (3, 2), (15, 6)], (80, 80, 16, True)),
        ([(1, 1), (9, 5), (1, 3), (0, 1), (0, 1), (1, 1), (0, 2)], (80, 80, 8, False)),
        (
            [(1, 1), (9, 5), (1, 3), (0, 1), (1, 1), (5, 3), (0, 1), (0, 2), (0, 1), (2, 2)],
            (80, 80, 12, True),
        ),
        ([(1, 1), (9, 5), (1, 3), (0, 1), (1, 1), (0, 3), (0, 1), (2, 2)], (80, 80, 8, False)),
    ],
)
@pytest.mark.parametrize("boxed", [False, True])
def test_header(fields, wanted, boxed):
    """Sizes small, by ratio and large; depths; turned; floating point; animation."""
    data = stream(*fields)
    if boxed:
        data = CONTAINER + (12 + len(data)).to_bytes(4) + b"jxlp" + bytes(4) + data
    header = read_header(data)
    assert (header.width, header.height, header.bits, header.plain) == wanted


def test_header_of_the_encoder():
    """Against another implementation."""
    found = read_header(jxl(Image.new("L", (9001, 70)), lossless=True))
    assert (found.width, found.height, found.bits, found.plain) == (9001, 70, 8, True)
    deep = Image.fromarray(np.zeros((70, 96), np.uint16))
    assert read_header(jxl(deep, lossless=True)).bits == 16


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ([(0, 1), (3, 2), (2**29, 30), (1, 3), (1, 1)], "more than 100 megapixels"),
        ([(1, 1), (0, 5), (1, 3), (1, 1)], "too small"),
        ([(1, 1), (9, 5), (1, 3), (0, 1), (0, 1), (0, 1), (1, 2)], "djxl photo.jxl photo.png"),
        ([(1, 1), (9, 5), (1, 3), (0, 1), (0, 1), (1, 1), (0, 2)], "djxl photo.jxl photo.png"),
    ],
)
def test_refused_before_it_is_decoded(tmp_path, fields, why):
    """Sizes out of bounds, and what the decoder would cut to 8 bits."""
    with pytest.raises(PhotoError, match=why):
        read(tmp_path, stream(*fields))


def test_without_the_extra(tmp_path, monkeypatch):
    """The remedy is named."""
    monkeypatch.setitem(sys.modules, "pillow_jxl", None)
    with pytest.raises(PhotoError, match=r"pip install 'unlit\[jxl\]'"):
        read(tmp_path, stream((1, 1), (9, 5), (1, 3), (1, 1)))


def test_damage(tmp_path):
    """One line, whatever the decoder does."""
    whole = jxl(picture(), lossless=True)
    for data in (whole[: len(whole) // 2], whole[:3], whole[:12] + b"\xff" * 40):
        with pytest.raises(PhotoError, match="damaged or cut off") as error:
            read(tmp_path, data)
        assert "\n" not in str(error.value)
