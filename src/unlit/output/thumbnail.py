"""The picture that stands for a result in a gallery: photo, albedo, and the face outdoors."""

from __future__ import annotations

import numpy as np
from PIL import Image

from ..face.reconstruction import Reconstruction
from .images import encoded, webp
from .relit import Relit

#: Pixels a side of each of the three; on screens of two pixels for one they are as sharp.
SIDE = 224


def thumbnail_webp(r: Reconstruction, pictures: Relit) -> bytes:
    """A WebP file of 3 SIDE x SIDE pixels, the three side by side. pictures: of `relit`."""
    inside = (r.face.mask > 0)[..., None]
    three = (
        encoded(r.photo.image),
        encoded(r.face.maps.diffuse_albedo * inside),
        pictures["outdoors"],
    )
    tiles = [
        Image.fromarray(picture).resize((SIDE, SIDE), Image.Resampling.LANCZOS) for picture in three
    ]
    return webp(np.concatenate([np.asarray(tile) for tile in tiles], axis=1))
