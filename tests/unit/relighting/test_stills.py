"""Pictures written as their photo's file was."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image, ImageCms

from unlit.photo.photo import Photo, read_photo
from unlit.relighting.stills import StillEncoder

SIZE = 72


@pytest.fixture
def pixels() -> np.ndarray:
    return np.random.default_rng(2).integers(0, 256, (SIZE, SIZE + 8, 3), dtype=np.uint8)


def _written(photo: Photo, folder: Path, ending: str) -> Path:
    encoder = StillEncoder(photo.tags)
    out = folder / f"out{ending}"
    out.write_bytes((encoder.png if ending == ".png" else encoder.jpeg)(photo.pixels))
    return out


def test_a_plain_photo_comes_back_to_the_bit(pixels: np.ndarray, tmp_path: Path) -> None:
    file = tmp_path / "in.png"
    Image.fromarray(pixels).save(file)
    out = _written(read_photo(file), tmp_path, ".png")
    np.testing.assert_array_equal(np.asarray(Image.open(out)), pixels)
    assert not Image.open(out).getexif()


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_the_profile_stays(pixels: np.ndarray, tmp_path: Path, ending: str) -> None:
    """A profile of other curves, with colours that read back the same."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    from unlit.photo import icc

    # Another white point of the matrix: primaries swapped, so that no shortcut for sRGB is taken.
    swapped = profile.replace(b"rXYZ", b"tXYZ").replace(b"bXYZ", b"rXYZ").replace(b"tXYZ", b"bXYZ")
    assert icc.matrix_profile(swapped, 256).matrix is not None
    smooth = cv2.GaussianBlur(pixels, (0, 0), 6)
    file = tmp_path / "in.png"
    Image.fromarray(smooth).save(file, icc_profile=swapped)
    photo = read_photo(file)
    out = _written(photo, tmp_path, ending)
    assert Image.open(out).info["icc_profile"] == swapped
    again = read_photo(out).pixels
    assert np.abs(again - photo.pixels).mean() < (1e-4 if ending == ".png" else 0.02)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_the_turn_is_told_as_done(pixels: np.ndarray, tmp_path: Path, ending: str) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    exif[ExifTags.Base.Make] = "Maker"
    file = tmp_path / "in.jpg"
    Image.fromarray(pixels).save(file, exif=exif)
    photo = read_photo(file)
    assert photo.pixels.shape == (SIZE + 8, SIZE, 3)
    found = Image.open(_written(photo, tmp_path, ending))
    assert found.size == (SIZE, SIZE + 8)
    assert found.getexif()[ExifTags.Base.Orientation] == 1
    assert found.getexif()[ExifTags.Base.Make] == "Maker"


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_a_large_exif_block(pixels: np.ndarray, tmp_path: Path, ending: str) -> None:
    """What a JPEG cannot hold is left out of it, and said so."""
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "Maker"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.UserComment] = bytes(70_000)
    file = tmp_path / "in.png"
    Image.fromarray(pixels).save(file, exif=exif)
    photo = read_photo(file)
    found = Image.open(_written(photo, tmp_path, ending)).getexif()
    assert found.get(ExifTags.Base.Make) == ("Maker" if ending == ".png" else None)
    warning = StillEncoder(photo.tags).warning(ending)
    assert (warning is None) == (ending == ".png")
    assert warning is None or "68 kB, is left out" in warning


def test_a_tiff_s_structure_is_no_exif(pixels: np.ndarray, tmp_path: Path) -> None:
    """Its strips, layers and packets stay behind; the camera goes on."""
    exif = Image.Exif()
    exif[ExifTags.Base.Model] = "Camera"
    exif[37724] = bytes(50_000)  # Photoshop's layers
    exif[700] = b"<x:xmpmeta/>"
    file = tmp_path / "in.tif"
    Image.fromarray(pixels).save(file, exif=exif)
    photo = read_photo(file)
    assert photo.tags is not None
    assert len(photo.tags.exif) < 1000
    found = Image.open(_written(photo, tmp_path, ".jpg")).getexif()
    assert set(found) <= {272, 274, 282, 283, 296, 34665}
    assert found[ExifTags.Base.Model] == "Camera"


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_exposure_and_place_go_on(pixels: np.ndarray, tmp_path: Path, ending: str) -> None:
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FNumber] = 4.0
    exif.get_ifd(ExifTags.IFD.GPSInfo)[ExifTags.GPS.GPSLatitudeRef] = "N"
    file = tmp_path / "in.jpg"
    Image.fromarray(pixels).save(file, exif=exif)
    found = Image.open(_written(read_photo(file), tmp_path, ending)).getexif()
    assert found.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FNumber] == 4
    assert found.get_ifd(ExifTags.IFD.GPSInfo)[ExifTags.GPS.GPSLatitudeRef] == "N"


def test_sixteen_bits_stay_sixteen(tmp_path: Path) -> None:
    deep = np.random.default_rng(3).integers(0, 65536, (SIZE, SIZE, 3)).astype(np.uint16)
    file = tmp_path / "in.png"
    assert cv2.imwrite(str(file), deep)
    out = _written(read_photo(file), tmp_path, ".png")
    found = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert found.dtype == np.uint16
    assert np.abs(found.astype(int) - deep).max() <= 2
    Image.open(io.BytesIO(out.read_bytes())).verify()


def test_numbers_that_are_none_become_black() -> None:
    broken = np.full((SIZE, SIZE, 3), np.nan, np.float32)
    found = np.asarray(Image.open(io.BytesIO(StillEncoder(None).png(broken))))
    assert (found == 0).all()
