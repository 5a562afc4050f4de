"""The photo's crop around the face, and what perception says of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..perception.regions import Regions
from ..photo.crop import Crop
from ..scene.camera import Camera
from ..scene.short_repr import short_repr


@dataclass(frozen=True)
class FacePhoto:
    """A face in a photo, S x S pixels.

    name: the photo's file name. image: (S, S, 3) float32 linear sRGB, >= 0. camera: the crop's
    pinhole camera; crop: where the crop lies in the photo. regions: soft masks in [0, 1] of skin,
    lips, eyes, eyebrows, mouth and background. landmarks: (478, 3) float64, pixels of the crop,
    z in pixels, near is small.
    white_luminance: cd/m^2 of the linear value 1; None where the photo does not tell it.
    """

    name: str
    image: np.ndarray
    camera: Camera
    crop: Crop
    regions: Regions
    landmarks: np.ndarray
    white_luminance: float | None = None

    __repr__ = short_repr
