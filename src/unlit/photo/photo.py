"""From a file to linear light.

`read_photo` decodes JPEG, PNG, TIFF, WebP and HEIC, 8 or 16 bits a channel, turns the picture
upright, and converts its colours to linear sRGB by its ICC profile (without one it is taken for
sRGB).

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
import pillow_heif
from PIL import ExifTags, Image, ImageCms, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from ..color import decode_srgb, encode_srgb
from ..errors import PhotoError
from ..storage.arrays import reason
from .icc import Profile, ProfileError, matrix_profile, srgb_profile

MAX_PIXELS = 100_000_000
MAX_BYTES = 1 << 30
MIN_SIDE = 64

_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP")
_HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
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
# Rows converted at a time, so that temporaries stay small beside the photo.
_ROWS = 256


@dataclass(frozen=True)
class Photo:
    """A photo, upright, in linear light.

    pixels: (H, W, 3) float32 linear sRGB; 1 is the white of the file. Colours outside the gamut
        of sRGB have components below 0 or above 1.
    alpha: (H, W) float32 in [0, 1], not multiplied into the pixels; None for an opaque photo.
    focal: focal length in pixels of this image from the EXIF entries, or None.
    white_luminance: cd/m^2 that the value 1 stands for by exposure time, f-number and ISO speed in
        EXIF (CALIBRATION), or None.
    source: the file's name, for messages.
    colours: how the colours were found, for the log: by the ICC profile, or as sRGB.

    >>> unlit.Photo.of(np.full((64, 64, 3), 255, np.uint8)).pixels.max()
    np.float32(1.0)
    """

    pixels: np.ndarray
    alpha: np.ndarray | None
    focal: float | None
    source: str
    colours: str = "sRGB (no profile)"
    white_luminance: float | None = None

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


@dataclass(frozen=True)
class _Decoded:
    """A file's values as stored: pixels (H, W, C) uint8 or uint16, C = 1 grey, 3, or 4 CMYK.

    alpha: (H, W) of the same type, or None.  white: the value that stands for 1.
    orientation: EXIF value 1 to 8 still to be applied.
    """

    pixels: np.ndarray
    alpha: np.ndarray | None
    white: int
    icc: bytes | None
    exif: Image.Exif
    orientation: int


def read_photo(path: Path | str) -> Photo:
    """Read the photo at `path`.

    Raises PhotoError, with a message of one line, if it is missing, unreadable, no picture,
    damaged, or has fewer than `MIN_SIDE` pixels a side or more than `MAX_PIXELS` in all; the
    size is checked before the pixels are decoded.

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
            decoded = _decode_heif(data, path) if _is_heif(data) else _decode(data, path)
            return _upright_photo(decoded, path.name)
    except Image.DecompressionBombError as error:
        raise PhotoError(
            f"{path}: more than {MAX_PIXELS / 1e6:.0f} megapixels; scale it down"
        ) from error
    except UnidentifiedImageError as error:
        raise PhotoError(
            f"{path}: not a picture that can be read; give a JPEG, PNG, TIFF, WebP or HEIC file"
        ) from error
    except MemoryError as error:
        raise PhotoError(f"{path}: too large for this machine's memory; scale it down") from error
    except _DAMAGED as error:
        raise PhotoError(
            f"{path}: the picture is damaged or cut off ({reason(error)}); "
            "get a fresh copy of the file"
        ) from error


def _upright_photo(decoded: _Decoded, source: str) -> Photo:
    alpha = None
    if decoded.alpha is not None and decoded.alpha.min() < decoded.white:
        alpha = (decoded.alpha / np.float32(decoded.white)).astype(np.float32)
        alpha = _upright(alpha, decoded.orientation)
    pixels, colours = _linear(decoded)
    pixels = _upright(pixels, decoded.orientation)
    focal = focal_from_exif(decoded.exif, pixels.shape[1], pixels.shape[0])
    return Photo(pixels, alpha, focal, source, colours, white_luminance_from_exif(decoded.exif))


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


def _check_size(width: int, height: int, path: Path) -> None:
    if width * height > MAX_PIXELS:
        raise PhotoError(
            f"{path}: {width} x {height} pixels, more than {MAX_PIXELS / 1e6:.0f} megapixels; "
            "scale it down"
        )
    if min(width, height) < MIN_SIDE:
        raise PhotoError(
            f"{path}: {width} x {height} pixels, too small; at least {MIN_SIDE} a side are needed"
        )


def _is_heif(data: bytes) -> bool:
    return data[4:8] == b"ftyp" and data[8:12] in _HEIF_BRANDS


def _decode_heif(data: bytes, path: Path) -> _Decoded:
    file: Any = pillow_heif.open_heif(data, convert_hdr_to_8bit=False)  # pyright: ignore[reportUnknownMemberType]
    info: dict[str, Any] = file.info
    width, height = file.size
    _check_size(width, height, path)
    pixels = np.asarray(file)
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    white = 255
    if pixels.dtype == np.uint16:
        # 10 and 12 bits arrive in the upper bits of 16.
        spare = 16 - int(info.get("bit_depth", 16))
        white = 0xFFFF >> spare << spare
    alpha = pixels[..., -1] if pixels.shape[-1] in (2, 4) else None
    exif = Image.Exif()
    if info.get("exif"):
        exif.load(info["exif"])
    # The turn is part of the format and has been applied; the EXIF entry only repeats it.
    colours = pixels[..., : 1 if pixels.shape[-1] < 3 else 3]
    return _Decoded(colours, alpha, white, info.get("icc_profile"), exif, orientation=1)


def _decode(data: bytes, path: Path) -> _Decoded:
    with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
        _check_size(*image.size, path)
        exif = image.getexif()
        # Both decoders turn a TIFF picture upright themselves, and no other format.
        turned = image.format == "TIFF"
        orientation = 1 if turned else exif.get(ExifTags.Base.Orientation, 1)
        # Pillow keeps 8 of 16 bits, but unlike OpenCV it tells a damaged file from a good one.
        image.load()
        icc = image.info.get("icc_profile")
        deep = _bits(image, data) == 16
        if image.mode in ("F", "I", "LAB", "HSV") or (deep and image.mode == "CMYK"):
            raise PhotoError(
                f"{path}: pixels of a type that is not supported ({image.mode}); "
                "save it as 8- or 16-bit RGB or grey"
            )
        pixels, alpha = _decode_16(data) if deep else _decode_8(image)
        white = 0xFFFF if deep else 0xFF
        return _Decoded(pixels, alpha, white, icc, exif, int(orientation))


def _bits(image: Image.Image, data: bytes) -> int:
    """Bits a channel in the file, which Pillow's mode does not tell."""
    if image.format == "PNG":
        return data[24]
    if isinstance(image, TiffImageFile):
        return max(image.tag_v2.get(ExifTags.Base.BitsPerSample, (8,)))
    return 8


def _decode_8(image: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    if image.mode == "1":
        image = image.convert("L")
    elif image.has_transparency_data:
        image = image.convert("RGBA")
    elif image.mode not in ("L", "CMYK"):
        image = image.convert("RGB")
    pixels = np.asarray(image)
    if image.mode == "RGBA":
        return pixels[..., :3], pixels[..., 3]
    return (pixels[..., None] if pixels.ndim == 2 else pixels), None


def _decode_16(data: bytes) -> tuple[np.ndarray, np.ndarray | None]:
    # IMREAD_UNCHANGED keeps 16 bits and alpha, and leaves the EXIF orientation to us.
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16:
        raise ValueError("the 16-bit decoder refuses it")
    if pixels.ndim == 2:
        return pixels[..., None], None
    return pixels[..., 2::-1], (pixels[..., 3] if pixels.shape[2] == 4 else None)


def _linear(decoded: _Decoded) -> tuple[np.ndarray, str]:
    """Linear sRGB (H, W, 3) float32 of the stored values, not turned, and how it was found."""
    pixels, levels, colours = decoded.pixels, decoded.white + 1, "sRGB (no profile)"
    if decoded.icc:
        try:
            profile = matrix_profile(decoded.icc, levels)
            if pixels.shape[2] in (1, 3) and len(profile.curves) in (3, pixels.shape[2]):
                return _apply(profile, pixels), "ICC profile"
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


def _through_tables(pixels: np.ndarray, decoded: _Decoded) -> np.ndarray | None:
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
