"""Damaged photos and colour profiles: a picture of finite numbers, or one line of what is wrong."""

import contextlib
import importlib
import io
import struct
import zlib

import cv2
import numpy as np
import pillow_heif
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from corrupt import damaged
from dng_file import dng, mosaic
from png_file import chrm, chunk, cicp, gama, png
from profiles import DISPLAY_P3, SRGB_CURVE, curv, grey_tables, matrix, para
from unlit.errors import PhotoError
from unlit.photo.icc import ProfileError, matrix_profile
from unlit.photo.jxl import read_header
from unlit.photo.photo import read_photo

FUZZ = settings.get_profile("fuzz")
PROFILE = matrix(DISPLAY_P3, SRGB_CURVE)


def encoded(form: str, mode: str = "RGB", **options) -> bytes:
    random = np.random.default_rng(3)
    channels = {"RGB": 3, "L": 1, "RGBA": 4, "CMYK": 4, "P": 1, "I;16": 1}[mode]
    kind = np.uint16 if mode == "I;16" else np.uint8
    pixels = random.integers(0, 256, (64, 70, channels)).astype(kind)
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769)[0xA405] = 50
    out = io.BytesIO()
    image = Image.fromarray(pixels.squeeze()) if mode != "P" else Image.new("P", (70, 64))
    if mode == "CMYK":
        image = Image.fromarray(pixels, "CMYK")
    image.save(out, form, exif=exif, **options)
    return out.getvalue()


def heif(**options) -> bytes:
    out = io.BytesIO()
    pillow_heif.from_pillow(Image.new("RGB", (70, 64), (90, 80, 70))).save(out, **options)
    return out.getvalue()


def deep_avif() -> bytes:
    pixels = np.full((64, 70, 3), 500, np.uint16)
    return cv2.imencode(".avif", pixels, [cv2.IMWRITE_AVIF_DEPTH, 10])[1].tobytes()


def jxl() -> list[bytes]:
    """None without the extra."""
    try:
        importlib.import_module("pillow_jxl")
    except ImportError:
        return []
    out = io.BytesIO()
    Image.new("RGB", (70, 64), (90, 80, 70)).save(out, "JXL", use_container=True)
    return [out.getvalue()]


GREY = np.full((64, 70, 3), 90, np.uint8)


PHOTOS = [
    encoded("JPEG", icc_profile=PROFILE),
    encoded("JPEG", "CMYK", icc_profile=grey_tables(4, b"CMYK")),
    encoded("JPEG", "L", progressive=True),
    encoded("PNG", "RGBA", icc_profile=PROFILE),
    encoded("PNG", "P"),
    encoded("PNG", "I;16"),
    encoded("TIFF", compression="tiff_lzw"),
    encoded("TIFF", "I;16"),
    encoded("TIFF", tiffinfo={318: (0.3127, 0.329), 319: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06)}),
    encoded("WEBP", lossless=True),
    heif(),
    heif(color_primaries=9, transfer_characteristics=18, matrix_coefficients=9, full_range_flag=1),
    encoded("AVIF"),
    deep_avif(),
    dng(mosaic((0.5, 0.4, 0.3), 64, 64)),
    *jxl(),
    png(GREY, 2, cicp(9, 16, 0, 0)),
    png(GREY, 2, gama(1.0), chrm(0.3457, 0.3585, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)),
]


@settings(FUZZ)
@given(damaged(PHOTOS))
def test_damaged_photos(tmp_path_factory, content):
    """Whatever is broken in the file, no other error than PhotoError, of one line."""
    path = tmp_path_factory.getbasetemp() / "photo.jpg"
    path.write_bytes(content)
    try:
        photo = read_photo(path)
    except PhotoError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(photo.pixels).all()
        assert photo.focal is None or 0 < photo.focal < 1e6


def png_of(width: int, height: int, body: bytes) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


@pytest.mark.parametrize(
    ("width", "height"), [(2**31 - 1, 2**31 - 1), (100_000, 100_000), (10**9, 64)]
)
def test_huge_sizes_take_no_memory(tmp_path, width, height):
    """A header that promises gigabytes is refused before anything is decoded."""
    (tmp_path / "x.png").write_bytes(png_of(width, height, b"\0" * 1000))
    with pytest.raises(PhotoError):
        read_photo(tmp_path / "x.png")


@settings(FUZZ)
@given(damaged([PROFILE, matrix(DISPLAY_P3, curv(0, 9, 65535)), matrix(DISPLAY_P3, para(0, 2.2))]))
def test_damaged_profiles(content):
    """Finite curves and matrix, or ProfileError, without a warning of NumPy's."""
    try:
        profile = matrix_profile(content, 256)
    except ProfileError:
        return
    assert np.isfinite(profile.curves).all()
    assert profile.matrix is None or np.isfinite(profile.matrix).all()


@settings(FUZZ)
@given(st.binary(max_size=90))
def test_any_header_of_jpeg_xl(content):
    """A size, or ValueError."""
    container = b"\0\0\0\x0cJXL \r\n\x87\n"
    for start in (b"\xff\n", container, container + b"\0\0\0\x50jxlc\xff\n"):
        with contextlib.suppress(ValueError):
            header = read_header(start + content)
            assert header.width > 0 and header.height > 0


@settings(FUZZ)
@given(st.tuples(*[st.integers(0, 255)] * 4) | st.just((9, 16, 0, 0)))
def test_any_code_points(tmp_path_factory, codes):
    """With a right checksum, so that they are looked at."""
    path = tmp_path_factory.getbasetemp() / "codes.png"
    path.write_bytes(png(GREY, 2, cicp(*codes)))
    with contextlib.suppress(PhotoError):
        assert np.isfinite(read_photo(path).pixels).all()


@settings(FUZZ)
@given(st.lists(st.integers(0, 2**32 - 1) | st.integers(0, 100_000), min_size=9, max_size=9))
def test_any_gamma_and_chromaticities(tmp_path_factory, numbers):
    """The same for gAMA and cHRM."""
    gamma, *xy = (number / 100_000 for number in numbers)
    path = tmp_path_factory.getbasetemp() / "gamma.png"
    path.write_bytes(png(GREY, 2, gama(gamma), chrm(*xy)))
    with contextlib.suppress(PhotoError):
        assert np.isfinite(read_photo(path).pixels).all()


@settings(FUZZ)
@given(st.binary(max_size=300))
def test_bytes_that_are_no_profile(content):
    """With the mark of a profile in its place, so that more than the mark is looked at."""
    data = content[:36].ljust(36, b"\0") + b"acsp" + content[36:]
    with contextlib.suppress(ProfileError):
        matrix_profile(data, 256)
