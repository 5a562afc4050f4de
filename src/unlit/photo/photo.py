"""From a file to linear light.

`read_photo` decodes JPEG, PNG, TIFF, WebP, HEIC and AVIF, 8 to 16 bits a channel (decode.py), turns
the picture upright, and converts its colours to linear sRGB by its ICC profile, or by what the file
says instead (colour_space.py). Only a file that says nothing is taken for sRGB.

Image frame (see scene/camera.py): x right, y down; pixel (row i, column j) covers
[j, j + 1] x [i, i + 1], its centre is (j + 0.5, i + 0.5).
"""

from __future__ import annotations

import io
import math
import struct
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import ExifTags, Image, ImageCms, UnidentifiedImageError

from ..color import decode_srgb, encode_srgb
from ..errors import PhotoError
from ..storage.arrays import reason
from .colour_space import coded_space
from .decode import decode
from .decoded import MAX_PIXELS, Decoded
from .icc import Profile, ProfileError, hdr_code_points, matrix_profile, srgb_profile

MAX_BYTES = 1 << 30

# What decoders raise on damaged files.
_DAMAGED = (
    *(OSError, SyntaxError, ValueError, EOFError, KeyError, IndexError, TypeError),
    *(struct.error, zlib.error, RuntimeError, cv2.error),
)
# Diagonal of the 36 mm x 24 mm film frame, by which equivalent focal lengths are defined.
_FILM_DIAGONAL_MM = math.hypot(36, 24)
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
#: Luminance, cd/m^2, that a photo records as 1, times t S / N^2 (exposure time in seconds, ISO
#: speed, f-number). By ISO 12232 a camera of standard output sensitivity S puts 10 / S lx s on the
#: sensor for the encoded value 118 of 255, and a lens 0.65 t / N^2 lx s for each cd/m^2.
CALIBRATION = 10 / (0.65 * 0.1812)
# In diagonals of the photo: equivalents of 9 to 300 mm. Others are wrong entries, such as those of
# a picture that was reduced with its sensor resolution left as it was.
_FOCAL_RANGE = (0.2, 7.0)
_BASE = ExifTags.Base
_EXPOSURE, _PLACE = ExifTags.IFD.Exif, ExifTags.IFD.GPSInfo
#: Entries of EXIF's main directory that tell of the picture, not of the file's structure.
_ABOUT = (
    *(_BASE.ImageDescription, _BASE.Make, _BASE.Model, _BASE.Software, _BASE.DateTime),
    *(_BASE.Artist, _BASE.HostComputer, _BASE.Copyright),
    *(_BASE.XResolution, _BASE.YResolution, _BASE.ResolutionUnit),
)
_BY_PROFILE = "ICC profile"
# Rows converted at a time, so that temporaries stay small beside the photo.
_ROWS = 256


@dataclass(frozen=True)
class FileTags:
    """What a picture made from a photo's file should carry on.

    icc: the profile that its colours were read by, if it is made of curves and a matrix. exif: what
    `camera_entries` keeps of its EXIF block, b"" if nothing. deep: whether it has more than 8 bits
    a channel.
    """

    icc: bytes | None
    exif: bytes
    deep: bool


@dataclass(frozen=True)
class Photo:
    """A photo, upright, in linear light.

    pixels: (H, W, 3) float32 linear sRGB; 1 is the white of the file (in PQ and HLG the reference
        white, above which are highlights). Colours outside the gamut of sRGB have components below
        0 or above 1.
    alpha: (H, W) float32 in [0, 1], not multiplied into the pixels; None for an opaque photo.
    focal: focal length in pixels of this image from the EXIF entries, or None.
    white_luminance: cd/m^2 that the value 1 stands for by exposure time, f-number and ISO speed in
        EXIF (CALIBRATION), or None.
    source: the file's name, for messages.
    colours: how the colours were found, for the log: by the ICC profile, by what the file says
        instead, or as sRGB.
    tags: of the file; None for an array.

    >>> unlit.Photo.of(np.full((64, 64, 3), 255, np.uint8)).pixels.max()
    np.float32(1.0)
    """

    pixels: np.ndarray
    alpha: np.ndarray | None
    focal: float | None
    source: str
    colours: str = "sRGB (no profile)"
    white_luminance: float | None = None
    tags: FileTags | None = None

    @staticmethod
    def of(pixels: np.ndarray, source: str = "array") -> Photo:
        """A photo from an array (H, W, 3): uint8 sRGB-encoded, or float linear sRGB.

        Raises PhotoError for another shape or type.
        """
        if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
            raise PhotoError(f"{source}: shape {pixels.shape}; give an array (H, W, 3)")
        if pixels.dtype == np.uint8:
            linear = decode_srgb(pixels.astype(np.float32) / 255)
        elif np.issubdtype(pixels.dtype, np.floating):
            linear = pixels.astype(np.float32)
        else:
            raise PhotoError(f"{source}: type {pixels.dtype}; give uint8 sRGB or float linear sRGB")
        if not np.isfinite(linear).all():
            raise PhotoError(f"{source}: some values are not finite numbers; replace them")
        return Photo(linear, None, None, source)

    def encoded8(self) -> np.ndarray:
        """The photo as (H, W, 3) uint8 sRGB, what networks and viewers expect."""
        out = np.empty(self.pixels.shape, np.uint8)
        for rows in _row_slices(len(out)):
            out[rows] = np.clip(np.rint(255 * encode_srgb(self.pixels[rows])), 0, 255)
        return out


def read_photo(path: Path | str) -> Photo:
    """Read the photo at `path`.

    Raises PhotoError, with a message of one line, if it is missing, unreadable, no picture,
    damaged, has colours that are not understood, or has fewer than 64 pixels a side or
    more than `MAX_PIXELS` in all; the size is checked before the pixels are decoded.

    >>> photo = unlit.read_photo(file)
    >>> photo.pixels.shape, photo.pixels.dtype
    ((512, 512, 3), dtype('float32'))
    """
    path = Path(path)
    data = _read_bytes(path)
    try:
        # Remarks of the decoders on odd but readable files are no concern of the user.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _upright_photo(decode(data, path), path.name)
    except Image.DecompressionBombError as error:
        raise PhotoError(
            f"{path}: more than {MAX_PIXELS / 1e6:.0f} megapixels; scale it down"
        ) from error
    except UnidentifiedImageError as error:
        raise PhotoError(
            f"{path}: not a picture that can be read; give a JPEG, PNG, TIFF, WebP, HEIC or AVIF "
            "file"
        ) from error
    except ProfileError as error:
        raise PhotoError(
            f"{path}: colours that cannot be read right: {error}; save it as sRGB or with an ICC "
            "profile"
        ) from error
    except MemoryError as error:
        raise PhotoError(f"{path}: too large for this machine's memory; scale it down") from error
    except _DAMAGED as error:
        raise PhotoError(
            f"{path}: the picture is damaged or cut off ({reason(error)}); "
            "get a fresh copy of the file"
        ) from error


def _upright_photo(decoded: Decoded, source: str) -> Photo:
    alpha = None
    if decoded.alpha is not None and decoded.alpha.min() < decoded.white:
        alpha = (decoded.alpha / np.float32(decoded.white)).astype(np.float32)
        alpha = _upright(alpha, decoded.orientation)
    pixels, colours = _linear(decoded)
    pixels = _upright(pixels, decoded.orientation)
    focal = focal_from_exif(decoded.exif, pixels.shape[1], pixels.shape[0])
    profile = decoded.icc if colours == _BY_PROFILE else None
    tags = FileTags(profile, camera_entries(decoded.exif), decoded.white > 0xFF)
    luminance = white_luminance_from_exif(decoded.exif)
    return Photo(pixels, alpha, focal, source, colours, luminance, tags)


def _read_bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise PhotoError(f"{path}: a folder; give one picture file")
        if not path.exists():
            raise PhotoError(f"{path}: no such file; check the name and the folder")
        if not path.is_file():
            raise PhotoError(f"{path}: not a regular file; give a picture file")
        if (size := path.stat().st_size) > MAX_BYTES:
            raise PhotoError(
                f"{path}: {size >> 20} MiB, more than {MAX_BYTES >> 20}; scale it down"
            )
        data = path.read_bytes()
    except PermissionError as error:
        raise PhotoError(f"{path}: no permission to read it; change its access rights") from error
    except (OSError, ValueError) as error:
        raise PhotoError(f"{path}: cannot be read ({reason(error)})") from error
    if not data:
        raise PhotoError(f"{path}: the file is empty; get a fresh copy of it")
    return data


def _linear(decoded: Decoded) -> tuple[np.ndarray, str]:
    """Linear sRGB (H, W, 3) float32 of the stored values, not turned, and how it was found."""
    pixels, levels, colours = decoded.pixels, decoded.white + 1, "sRGB (no profile)"
    codes = hdr_code_points(decoded.icc) if decoded.icc else None
    space = coded_space(*codes) if codes else decoded.space
    if space is not None and pixels.shape[2] in (1, 3):
        return _apply(space.profile(decoded.white), pixels), space.name
    if decoded.icc:
        try:
            profile = matrix_profile(decoded.icc, levels)
            if pixels.shape[2] in (1, 3) and len(profile.curves) in (3, pixels.shape[2]):
                return _apply(profile, pixels), _BY_PROFILE
        except ProfileError:
            converted = _through_tables(pixels, decoded)
            if converted is not None:
                return _apply(srgb_profile(256), converted), "ICC profile (tables, 8 bits)"
        colours = "sRGB (the file's ICC profile cannot be used)"
    if pixels.shape[2] == 4:
        pixels = np.asarray(_pillow_image(pixels).convert("RGB"))
        colours = colours.replace("sRGB", "uncalibrated CMYK")
    return _apply(srgb_profile(levels), pixels), colours


def _apply(profile: Profile, pixels: np.ndarray) -> np.ndarray:
    """Linear sRGB (H, W, 3) float32 of stored values (H, W, 1 or 3)."""
    out = np.empty((*pixels.shape[:2], 3), np.float32)
    for channel in range(3):
        curve = profile.curves[min(channel, len(profile.curves) - 1)]
        np.take(curve, pixels[..., min(channel, pixels.shape[2] - 1)], out=out[..., channel])
    if profile.matrix is not None:
        for rows in _row_slices(len(out)):
            out[rows] = out[rows] @ profile.matrix.T
    return out


def _through_tables(pixels: np.ndarray, decoded: Decoded) -> np.ndarray | None:
    """sRGB (H, W, 3) uint8 by LittleCMS, or None if it cannot use the profile either."""
    if decoded.white > 0xFF:
        pixels = (pixels * np.float32(255 / decoded.white) + 0.5).astype(np.uint8)
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(decoded.icc or b""))
        srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))  # pyright: ignore[reportUnknownMemberType, reportUnknownArgumentType]
        image = ImageCms.profileToProfile(_pillow_image(pixels), source, srgb, outputMode="RGB")
    except (ImageCms.PyCMSError, OSError, ValueError):
        return None
    return np.asarray(image)


def _pillow_image(pixels: np.ndarray) -> Image.Image:
    mode = {1: "L", 3: "RGB", 4: "CMYK"}[pixels.shape[2]]
    size = (pixels.shape[1], pixels.shape[0])
    return Image.frombytes(mode, size, np.ascontiguousarray(pixels).tobytes())


def _row_slices(rows: int) -> list[slice]:
    return [slice(start, start + _ROWS) for start in range(0, rows, _ROWS)]


def _upright(array: np.ndarray, orientation: int) -> np.ndarray:
    """Undo the EXIF orientation (1 to 8) of an array (H, W, ...); other values mean upright."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    return np.ascontiguousarray(array)


def focal_from_exif(exif: Image.Exif, width: int, height: int) -> float | None:
    """Focal length in pixels of an image of `width` x `height` pixels, or None if not known.

    From the 35 mm equivalent, which is defined by the diagonal of the frame; else from the focal
    length in millimetres and the resolution of the sensor plane, which counts pixels of the
    picture as taken. None, too, where the image's proportions are not those of the picture as
    taken: it has been cropped, by how much nobody knows.
    """
    tags, base = exif.get_ifd(ExifTags.IFD.Exif), ExifTags.Base
    short_side, long_side = sorted((width, height))
    diagonal = math.hypot(width, height)
    # An editor that reduces a picture may update one of the two entries; the larger is older.
    taken_short, taken_long = max(
        sorted((_number(tags, base.ExifImageWidth), _number(tags, base.ExifImageHeight))),
        sorted((_number(exif, base.ImageWidth), _number(exif, base.ImageLength))),
    )
    if taken_short and abs(taken_short / taken_long * long_side - short_side) > 2:
        return None
    if equivalent := _number(tags, base.FocalLengthIn35mmFilm):
        focal = equivalent / _FILM_DIAGONAL_MM * diagonal
    else:
        unit = _MM_PER_UNIT.get(int(_number(tags, base.FocalPlaneResolutionUnit)), 25.4)
        pixels_per_mm = _number(tags, base.FocalPlaneXResolution) / unit
        scale = long_side / taken_long if taken_long else 1.0
        focal = _number(tags, base.FocalLength) * pixels_per_mm * scale
    return focal if _FOCAL_RANGE[0] < focal / diagonal < _FOCAL_RANGE[1] else None


def camera_entries(exif: Image.Exif) -> bytes:
    """An EXIF block of what `exif` says about camera, place, author and print size; b"" if nothing.

    Not of how the file is built: a TIFF's entries are its strips, layers and profile, too.
    """
    kept = Image.Exif()
    for tag in _ABOUT:
        if tag in exif:
            kept[tag] = exif[tag]
    exposure, place = (dict(exif.get_ifd(ifd)) for ifd in (_EXPOSURE, _PLACE))
    if ExifTags.IFD.Interop in exposure:  # an offset in the old file
        exposure[ExifTags.IFD.Interop] = dict(exif.get_ifd(ExifTags.IFD.Interop))
    for ifd, entries in ((_EXPOSURE, exposure), (_PLACE, place)):
        if entries:
            kept.get_ifd(ifd).update(entries)
    if not (len(kept) or exposure or place):
        return b""
    try:
        return kept.tobytes()
    except _DAMAGED:  # entries that cannot be written are no reason to refuse a photo
        return b""


def white_luminance_from_exif(exif: Image.Exif) -> float | None:
    """Luminance, cd/m^2, that the value 1 stands for, or None if not known."""
    tags, base = exif.get_ifd(ExifTags.IFD.Exif), ExifTags.Base
    time, number = _number(tags, base.ExposureTime), _number(tags, base.FNumber)
    speed = tags.get(base.ISOSpeedRatings, 0)  # some cameras write several
    speed = _number({0: speed[0] if isinstance(speed, tuple) and speed else speed}, 0)
    if not (time and number and speed):
        return None
    return CALIBRATION * number**2 / (time * speed)


def _number(tags: Mapping[int, Any], tag: int) -> float:
    """A positive, finite EXIF number, or 0."""
    try:
        value = float(tags.get(tag, 0))
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return value if math.isfinite(value) and value > 0 else 0.0
