"""JPEG XL of 8 bits, by `pip install 'unlit[jxl]'`.

pillow-jxl-plugin decodes the whole file when it opens it, and keeps 8 of more bits. So the header
is read here first (ISO/IEC 18181-1, annex D): its size is held to the bounds before anything is
decoded, and what has more than 8 bits, or moves, is refused with the remedy.
"""

# pyright: basic
from __future__ import annotations

import importlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

from ..errors import PhotoError
from .decoded import Decoded, check_size

_CODESTREAM = b"\xff\x0a"
_CONTAINER = b"\0\0\0\x0cJXL \r\n\x87\n"
#: Width over height by code, where the width is not written.
_RATIOS = {1: (1, 1), 2: (12, 10), 3: (4, 3), 4: (3, 2), 5: (16, 9), 6: (5, 4), 7: (2, 1)}
_MOST_BOXES = 100
_REMEDY = "convert it to PNG, as `djxl photo.jxl photo.png`"
_WITHOUT = f"a JPEG XL file: `pip install 'unlit[jxl]'` to read those of 8 bits, or {_REMEDY}"


def is_jxl(data: bytes) -> bool:
    """Whether it is JPEG XL, bare or in its container."""
    return data.startswith((_CODESTREAM, _CONTAINER))


@dataclass(frozen=True)
class Header:
    """width, height: pixels, before the picture is turned. bits: a channel. plain: whether it is
    one picture of whole numbers without a preview; bits are not known otherwise.
    """

    width: int
    height: int
    bits: int
    plain: bool


def decode_jxl(data: bytes, path: Path) -> Decoded:
    """Decode a JPEG XL file.

    path: its name, for messages. Raises PhotoError without the extra `jxl`, for more than 8 bits,
    an animation, or a size out of bounds; ValueError for damaged data.
    """
    header = read_header(data)
    check_size(header.width, header.height, path)
    if not header.plain or header.bits > 8:
        raise PhotoError(
            f"{path}: JPEG XL of more than 8 bits, or with an animation or preview; {_REMEDY}"
        )
    try:
        importlib.import_module("pillow_jxl")  # adds the format to Pillow
    except ImportError as error:
        raise PhotoError(f"{path}: {_WITHOUT}") from error
    try:
        with Image.open(io.BytesIO(data), formats=("JXL",)) as image:
            # A JPEG in new clothes comes as it was; else the turn has been applied.
            jpeg = bool(getattr(image, "jpeg", False))
            exif = image.getexif()
            orientation = int(exif.get(ExifTags.Base.Orientation, 1)) if jpeg else 1
            if image.mode not in ("L", "LA", "RGB", "RGBA"):
                raise PhotoError(f"{path}: JPEG XL of type {image.mode}; {_REMEDY}")
            pixels = np.asarray(image)
            icc = image.info.get("icc_profile")
    except BaseException as error:
        if type(error).__name__ == "PanicException":  # of Rust; it is no Exception
            raise ValueError("the decoder gave up") from error
        raise
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    colours = 1 if pixels.shape[2] < 3 else 3
    alpha = pixels[..., -1] if pixels.shape[2] in (2, 4) else None
    return Decoded(pixels[..., :colours], alpha, 0xFF, icc, None, exif, orientation)


def read_header(data: bytes) -> Header:
    """The size and depth that the codestream begins with. Raises ValueError where it is cut off."""
    stream = _codestream(data)
    if not stream.startswith(_CODESTREAM):
        raise ValueError("no JPEG XL codestream")
    bits = _Bits(stream[2:])
    width, height = _size(bits)
    depth, plain = 8, True
    if not bits.take(1):  # else all is as usual
        if bits.take(1):
            bits.take(3)  # the turn
            if bits.take(1):
                _size(bits)  # for show
            plain = bits.take(2) == 0  # a preview, an animation
        if plain:
            plain = bits.take(1) == 0  # floating point
            depth = (8, 10, 12, 0)[selector := bits.take(2)]
            if selector == 3:
                depth = 1 + bits.take(6)
    return Header(width, height, depth, plain)


def _size(bits: _Bits) -> tuple[int, int]:
    small = bits.take(1)
    height = _side(bits, small)
    ratio = bits.take(3)
    if ratio == 0:
        return _side(bits, small), height
    over, under = _RATIOS[ratio]
    return height * over // under, height


def _side(bits: _Bits, small: int) -> int:
    if small:
        return 8 * (1 + bits.take(5))
    return 1 + bits.take((9, 13, 18, 30)[bits.take(2)])


class _Bits:
    """Numbers from bytes, the lowest bits first."""

    def __init__(self, data: bytes) -> None:
        self._left = 8 * min(len(data), 64)
        self._number = int.from_bytes(data[:64], "little")

    def take(self, count: int) -> int:
        if count > self._left:
            raise ValueError("its header is cut off")
        value = self._number & ((1 << count) - 1)
        self._number >>= count
        self._left -= count
        return value


def _codestream(data: bytes) -> bytes:
    """Its beginning, which in a container is in the first box of the kind jxlc or jxlp."""
    if not data.startswith(_CONTAINER):
        return data[:80]
    at = 0
    for _ in range(_MOST_BOXES):
        size, kind = int.from_bytes(data[at : at + 4]), data[at + 4 : at + 8]
        head = 8
        if size == 1:
            size, head = int.from_bytes(data[at + 8 : at + 16]), 16
        if kind in (b"jxlc", b"jxlp"):
            start = at + head + (4 if kind == b"jxlp" else 0)
            return data[start : start + 80]
        if size < head or at + size >= len(data):
            break
        at += size
    raise ValueError("no JPEG XL codestream")
