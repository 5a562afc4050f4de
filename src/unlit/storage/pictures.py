"""Read a picture of any size as linear values: a subject's maps, and photographed lights."""

from __future__ import annotations

import os
import struct
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from ..color import decode_srgb
from ..errors import PictureError
from ..machine.runtime import mitsuba, second_thread

#: Larger maps are reduced to this many pixels a side, by area means of linear values.
LARGEST = 4096
_MAX_SIDE = 16384
#: 16384 x 8192, also below what Pillow refuses by itself.
_MAX_PIXELS = 1 << 27
_TOO_MANY = "at most 134 million pixels; give a smaller picture"
_MAX_BYTES = 2 << 30


def read_picture(path: Path, encoding: str = "linear") -> np.ndarray:
    """(H, W, 3) float32, row 0 at the top, of a PNG, JPEG, TIFF, EXR or HDR file.

    encoding: "srgb" to decode it, "linear" to take it as it is; integers become 0 to 1. Grey is
    repeated, alpha is dropped. Raises PictureError that names the file.
    """
    try:
        floating = path.suffix.lower() in (".exr", ".hdr")
        width, height = (_floating_size if floating else _integer_size)(path)
        if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE):
            raise PictureError(f"{path}: {width} x {height} pixels; at most {_MAX_SIDE} a side")
        if width * height > _MAX_PIXELS:
            raise PictureError(f"{path}: {width} x {height} pixels; {_TOO_MANY}")
        pixels = _floating(path) if floating else _integer(path)
    except PictureError:
        raise
    except Image.DecompressionBombError as error:
        raise PictureError(f"{path}: {_TOO_MANY}") from error
    except OSError as error:
        reason = error.strerror or "no PNG, JPEG, TIFF, EXR or HDR picture"
        raise PictureError(f"{path}: cannot be read ({reason})") from error
    except (ValueError, RuntimeError, struct.error, cv2.error) as error:
        raise PictureError(f"{path}: no whole picture ({error})") from error
    if encoding == "srgb":
        pixels = decode_srgb(pixels)
    if not np.isfinite(pixels).all():
        raise PictureError(f"{path}: some values are not finite numbers")
    shrink = LARGEST / max(pixels.shape)
    if shrink < 1:
        size = (round(pixels.shape[1] * shrink), round(pixels.shape[0] * shrink))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return pixels


def _integer_size(path: Path) -> tuple[int, int]:
    with warnings.catch_warnings():
        # Pillow warns from 89 million pixels on; ours is the limit that counts.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with Image.open(path) as header:
            return header.size


def _integer(path: Path) -> np.ndarray:
    pixels: Any = cv2.imread(os.fspath(path), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError("it cannot be decoded")
    if not np.issubdtype(pixels.dtype, np.floating):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    if pixels.ndim == 2:
        return np.repeat(pixels[..., None], 3, axis=2).astype(np.float32)
    return np.ascontiguousarray(pixels[..., 2::-1], dtype=np.float32)  # OpenCV has blue first


def _floating_size(path: Path) -> tuple[int, int]:
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError("larger than 2 GB")
    with path.open("rb") as file:
        header = file.read(1 << 16)
    if path.suffix.lower() == ".exr":
        mark = b"dataWindow\0box2i\0"
        place = header.index(mark) + len(mark)
        left, top, right, bottom = struct.unpack_from("<4x4i", header, place)
        return right - left + 1, bottom - top + 1
    words = header[: header.index(b"\n", header.index(b"\n\n") + 2)].split()[-4:]
    if words[0] != b"-Y" or words[2] != b"+X":
        raise ValueError("rows in another order than from the top")
    return int(words[3]), int(words[1])


def _floating(path: Path) -> np.ndarray:
    mi = mitsuba()
    with second_thread():
        bitmap = mi.Bitmap(os.fspath(path))
    bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    return np.array(bitmap, dtype=np.float32)
