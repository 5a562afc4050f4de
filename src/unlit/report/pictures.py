"""Pictures inside the page: WebP, which every browser shows and which is small."""

from __future__ import annotations

import base64
import io

import numpy as np
from PIL import Image

_QUALITY = 90


def webp(image: np.ndarray, largest: int | None = None) -> bytes:
    """A WebP file of (H, W) or (H, W, 3) uint8, to look at, at most `largest` pixels a side."""
    picture = Image.fromarray(image).convert("RGB")
    if largest is not None:
        picture.thumbnail((largest, largest), Image.Resampling.LANCZOS)
    return _saved(picture, quality=_QUALITY, method=4)


def webp_exact(image: np.ndarray) -> bytes:
    """A WebP file of (H, W) or (H, W, 3) uint8 without loss: for data that happen to be pixels."""
    return _saved(Image.fromarray(image).convert("RGB"), lossless=True, quality=50, method=4)


def _saved(picture: Image.Image, **options: bool | int) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, "WEBP", **options)
    return stream.getvalue()


def data_uri(content: bytes) -> str:
    """`content`, a WebP file, as the address of an <img>."""
    return "data:image/webp;base64," + base64.b64encode(content).decode()
