"""Where in the texture layout each region of the skin is, to select by: an ID map."""

from __future__ import annotations

import numpy as np

from ..face.reconstruction import Reconstruction
from ..scene.maps import fill
from .geometry import welded
from .parts import SKIN
from .texels import texels_of

REGION_MAP = "atlas_regions.png"
#: By region of the skin (head/skin_regions.py): its colour where it is alone.
REGION_COLOURS = {
    "forehead": (255, 0, 0),
    "nose": (0, 255, 0),
    "cheeks": (0, 0, 255),
    "lids": (255, 255, 0),
    "chin": (255, 0, 255),
    "upper_lip": (0, 255, 255),
    "ears": (255, 255, 255),
    "rest": (128, 128, 128),
}


def region_map(r: Reconstruction, regions: np.ndarray, part: np.ndarray, size: int) -> np.ndarray:
    """(size, size, 3) uint8: the regions' colours, mixed by their weights; no skin is black.

    regions: (V, 8), as FittedHead.skin_regions. part: (F,), as in Atlas.
    """
    mesh = welded(r)
    texels = texels_of(mesh, size)
    shares = texels.at(regions[mesh.vertex], mesh.triangles)
    colour = shares @ np.array(list(REGION_COLOURS.values()), np.float32)
    image = np.zeros((size * size, 3), np.float32)
    image[texels.index] = colour * (part[texels.triangle] == SKIN)[:, None]
    known = np.zeros(size * size, bool)
    known[texels.index] = True
    filled = fill(image.reshape(size, size, 3), known.reshape(size, size))
    return np.rint(filled).astype(np.uint8)
