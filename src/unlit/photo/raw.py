"""The raw files of cameras (DNG, NEF, CR3, ARW and others): linear light as the sensor saw it.

LibRaw, by `pip install 'unlit[raw]'`, puts the mosaic together and applies the white balance of the
camera and its colour matrix, but no tone curve and no brightening: 1 is where the sensor saturates.
Its output is taken in BT.2020, whose gamut is wider than that of sRGB, so that colours outside keep
their negative components.
"""

# pyright: basic
from __future__ import annotations

import contextlib
import importlib
import io
import struct
from pathlib import Path
from typing import Any

from PIL import Image

from ..errors import PhotoError
from .colour_space import BT2020, ColourSpace, power
from .decoded import Decoded, check_size

_SUFFIXES = (
    *(".dng", ".nef", ".nrw", ".cr2", ".cr3", ".crw", ".arw", ".srf", ".sr2", ".raf", ".orf"),
    *(".rw2", ".pef", ".srw", ".3fr", ".fff", ".iiq", ".mos", ".mrw", ".rwl", ".x3f", ".erf"),
)
#: How files of those that are no TIFF begin: Fujifilm, Olympus, Panasonic, Canon.
_BEGINNINGS = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0")
#: Tags of TIFF, and the values that only raw files have in the first directory: a reduced picture
#: there is the preview, which is not to be taken for the photo.
_SUBFILE, _PHOTOMETRIC, _DNG_VERSION = 254, 262, 50706
_MOSAIC, _LINEAR_RAW = 32803, 34892
_MOST_TAGS = 500


def is_raw(data: bytes, path: Path) -> bool:
    """Whether it is a camera's raw file, by its content or the ending of its name."""
    if path.suffix.lower() in _SUFFIXES or data.startswith(_BEGINNINGS):
        return True
    if data[4:12] == b"ftypcrx ":
        return True
    if data[:4] not in (b"II*\0", b"MM\0*"):
        return False
    with contextlib.suppress(struct.error):
        return _is_raw_tiff(data, "<" if data[:2] == b"II" else ">")
    return False


def _is_raw_tiff(data: bytes, order: str) -> bool:
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, start)
    for at in range(start + 2, start + 2 + 12 * min(count, _MOST_TAGS), 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, at)
        (value,) = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", data, at + 8)
        if (
            tag == _DNG_VERSION
            or (tag == _SUBFILE and value & 1)
            or (tag == _PHOTOMETRIC and value in (_MOSAIC, _LINEAR_RAW))
        ):
            return True
    return False


def decode_raw(data: bytes, path: Path) -> Decoded:
    """Decode a raw file, turned upright, without what lies beyond the sensor's saturation.

    path: its name, for messages. Raises PhotoError without the extra `raw`, or for a size out of
    bounds; ValueError for what LibRaw refuses.
    """
    try:
        rawpy: Any = importlib.import_module("rawpy")
    except ImportError as error:
        raise PhotoError(
            f"{path}: a camera's raw file: `pip install 'unlit[raw]'` to read it, or save it as a "
            "16-bit TIFF or a JPEG"
        ) from error
    try:
        with rawpy.imread(io.BytesIO(data)) as raw:
            check_size(raw.sizes.width, raw.sizes.height, path)
            pixels = raw.postprocess(
                gamma=(1, 1),
                no_auto_bright=True,
                adjust_maximum_thr=0.0,
                use_camera_wb=True,
                output_color=rawpy.ColorSpace.Rec2020,
                output_bps=16,
            )
    except rawpy.LibRawError as error:
        said = error.args[0] if error.args else ""
        text = said.decode(errors="replace") if isinstance(said, bytes) else str(said)
        raise ValueError(f"LibRaw: {text}") from error
    space = ColourSpace("camera raw", BT2020, power(1.0))
    return Decoded(pixels, None, 0xFFFF, None, space, _exif(data), orientation=1)


def _exif(data: bytes) -> Image.Exif:
    """Of the files that are TIFF; without what does not hold for the picture as it is decoded.

    The sizes are a preview's. Nor is the exposure told: a sensor's saturation is not the white by
    which ISO 12232 rates its speed.
    """
    exif = Image.Exif()
    with contextlib.suppress(Exception):  # it is not vital, and Pillow may raise anything
        exif.load(data)
        for tag in (256, 257):
            exif.pop(tag, None)
        exif.get_ifd(0x8769).pop(33434, None)
    return exif
