"""A mask of the user's: which skin of the photo may be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..color import encode_srgb
from ..errors import FaceError, PhotoError
from ..photo.photo import Photo, read_photo
from .regions import REGIONS, Regions


def read_mask(mask: str | Path | np.ndarray, photo: Photo) -> np.ndarray:
    """(H, W) float32 in [0, 1] of the photo's size: 1 is skin to use, 0 is to be left out.

    mask: a picture file, whose grey levels as stored count (white 1, black 0; colours by their
    mean), or an array: uint8, 255 is white, or others from 0 to 1. Raises PhotoError when it cannot
    be read or has another size.
    """
    if isinstance(mask, np.ndarray):
        name, grey = "mask", np.asarray(mask, np.float32)
        grey = grey / 255 if mask.dtype == np.uint8 else grey
    else:
        name, grey = str(mask), encode_srgb(read_photo(mask).pixels).mean(axis=2)
    height, width = photo.pixels.shape[:2]
    if grey.shape != (height, width):
        found = " x ".join(str(size) for size in reversed(grey.shape))
        raise PhotoError(
            f"{name}: {found} pixels, but {photo.source} has {width} x {height}; "
            "give a mask of the photo's size"
        )
    if not np.isfinite(grey).all():
        raise PhotoError(f"{name}: some values are not finite numbers; give values from 0 to 1")
    return np.clip(grey, 0, 1)


def painted(regions: Regions, face: np.ndarray) -> Regions:
    """`regions` with the share of the face at each pixel set to `face` (S, S), 0 to 1.

    Its parts shrink together; what is added to it is skin. Raises FaceError if nothing is left.
    """
    if face.max() <= 0.5:
        raise FaceError("the mask leaves nothing of the face; paint the skin to use white")
    weights = regions.weights.copy()
    was = regions.face
    other = face != was
    old, new = was[other], face[other]
    rows = weights[other]
    parts = len(REGIONS)
    rows[:, :parts] *= np.minimum(new / np.maximum(old, 1e-6), 1)[:, None]
    rows[:, 0] += np.maximum(new - old, 0)
    rows[:, parts] = np.maximum(1 - rows[:, :parts].sum(axis=1), 0)
    weights[other] = rows
    return Regions(weights, regions.shares)
