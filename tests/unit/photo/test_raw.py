"""raw.py: raw files of cameras are linear light, and are not taken for their previews."""

import io
import struct
import sys

import numpy as np
import pytest
from PIL import Image

from dng_file import P3_TO_XYZ, dng, mosaic
from unlit.errors import PhotoError
from unlit.photo.photo import read_photo
from unlit.photo.raw import is_raw


def read(tmp_path, data, name="photo.dng"):
    (tmp_path / name).write_bytes(data)
    return read_photo(tmp_path / name)


@pytest.mark.parametrize("colour", [(0.6, 0.3, 0.1), (0.02, 0.5, 0.9), (1.0, 1.0, 1.0)])
def test_values_are_linear(tmp_path, colour):
    """No curve, no brightening: the sensor's values through the matrix of the file."""
    pytest.importorskip("rawpy")
    photo = read(tmp_path, dng(mosaic(colour)))
    np.testing.assert_allclose(photo.pixels[40, 50], colour, atol=1e-3)
    assert photo.colours == "camera raw"
    assert photo.white_luminance is None


def test_white_balance_of_the_camera(tmp_path):
    """What the camera says is white becomes white."""
    pytest.importorskip("rawpy")
    neutral = np.array([0.5, 1.0, 0.625])
    photo = read(tmp_path, dng(mosaic(0.4 * neutral), neutral))
    np.testing.assert_allclose(photo.pixels[40, 50], 0.4, rtol=0.02)


def test_colours_outside_srgb_stay_outside(tmp_path):
    """A camera with the primaries of Display P3 and a strong red: its green is negative."""
    pytest.importorskip("rawpy")
    photo = read(tmp_path, dng(mosaic((0.8, 0.02, 0.02)), to_xyz=P3_TO_XYZ))
    np.testing.assert_allclose(photo.pixels[40, 50], (0.9754, -0.0128, 0.0046), atol=2e-3)


def test_upright_once(tmp_path):
    """LibRaw turns it."""
    pytest.importorskip("rawpy")
    assert read(tmp_path, dng(mosaic((0.5, 0.5, 0.5)), orientation=6)).pixels.shape == (100, 80, 3)


@pytest.mark.parametrize("name", ["photo.dng", "photo.tif"])
def test_without_the_extra_it_is_refused(tmp_path, monkeypatch, name):
    """By content, too: Pillow would read a preview, or grey stripes."""
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(PhotoError, match=r"pip install 'unlit\[raw\]'"):
        read(tmp_path, dng(mosaic((0.5, 0.5, 0.5))), name)


def test_sizes_and_damage_are_refused(tmp_path):
    """Before it is decoded; what LibRaw refuses is one line."""
    pytest.importorskip("rawpy")
    whole = dng(mosaic((0.5, 0.5, 0.5)))
    with pytest.raises(PhotoError, match="too small"):
        read(tmp_path, dng(mosaic((0.5, 0.5, 0.5), 30, 40)))
    with pytest.raises(PhotoError, match="damaged or cut off"):
        read(tmp_path, whole[:3000])
    with pytest.raises(PhotoError, match="damaged or cut off"):
        read(tmp_path, b"no raw file at all", "x.nef")


def test_what_is_raw(tmp_path):
    """By content; ordinary TIFF is not."""
    out = io.BytesIO()
    Image.new("RGB", (80, 80)).save(out, "TIFF")
    plain, name = out.getvalue(), tmp_path / "x.tif"
    assert not is_raw(plain, name)
    assert is_raw(plain, tmp_path / "x.NEF")
    assert is_raw(b"\0\0\0\x18ftypcrx \0\0", name)
    assert is_raw(b"FUJIFILMCCD-RAW 0201", name)
    preview = b"II*\0" + struct.pack("<IHHHII", 8, 1, 254, 4, 1, 1)
    assert is_raw(preview, name)
    assert not is_raw(preview[:-1], name)
    assert not is_raw(b"MM\0*\xff\xff\xff\xff", name)
