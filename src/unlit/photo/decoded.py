"""What every decoder returns, and the sizes that all of them are held to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from ..errors import PhotoError
from .colour_space import ColourSpace

MAX_PIXELS = 100_000_000
MIN_SIDE = 64


@dataclass(frozen=True)
class Decoded:
    """A file's values as stored: pixels (H, W, C) uint8 or uint16, C = 1 grey, 3, or 4 CMYK.

    alpha: (H, W) of the same type, or None.  white: the value that stands for 1.
    icc, space: what the values mean: an ICC profile or what the file says instead, not both.
    orientation: EXIF value 1 to 8 still to be applied.
    """

    pixels: np.ndarray
    alpha: np.ndarray | None
    white: int
    icc: bytes | None
    space: ColourSpace | None
    exif: Image.Exif
    orientation: int


def check_size(width: int, height: int, path: Path) -> None:
    """Raise PhotoError for a picture of too many or too few pixels, before it is decoded."""
    if width * height > MAX_PIXELS:
        raise PhotoError(
            f"{path}: {width} x {height} pixels, more than {MAX_PIXELS / 1e6:.0f} megapixels; "
            "scale it down"
        )
    if min(width, height) < MIN_SIDE:
        raise PhotoError(
            f"{path}: {width} x {height} pixels, too small; at least {MIN_SIDE} a side are needed"
        )
