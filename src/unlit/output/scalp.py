"""The scalp in the colour of the hair, for those who put no hair model on the head.

The photo does not show what is below hair. As an option the head model's scalp, and what else of
its skin the photo shows to be hair, gets the hair's mean colour instead of the skin's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SettingsError
from ..face.reconstruction import Reconstruction
from ..head.model import VERTEX_REGIONS
from ..head.sources.library import head_model
from ..scene.normals import vertex_normals
from .evidence import hair_share

#: What the scalp under hair may be.
SCALPS = ("skin", "hair")
#: The parser's share from which a pixel is nothing but hair, and of how many pixels, of the crop.
_SURE, _ENOUGH = 0.9, 0.002
_BOUNDS = 0.004, 0.8


@dataclass(frozen=True)
class Hair:
    """cover: (V,) bool, vertices that hair covers. albedo: (3,) linear sRGB, under white light."""

    cover: np.ndarray
    albedo: np.ndarray


def hair_of(r: Reconstruction) -> Hair:
    """The hair of `r`. Its albedo is the photo's mean there over the face's mean shading.

    Raises SettingsError where the photo shows no hair, or the mesh is not of the head model that
    the settings name; ModelError where that is not there.
    """
    share = hair_share(r)
    sure, face = share > _SURE, r.face.mask > 0
    if sure.mean() < _ENOUGH or not face.any():
        raise SettingsError("scalp hair: the photo shows no hair; use scalp skin")
    shading = r.images.diffuse_shading[face].mean(axis=0)
    albedo = r.photo.image[sure].mean(axis=0) / np.maximum(shading, 1e-6)
    model = head_model(r.settings.head_model)
    mesh = r.face.mesh
    if len(model.neutral) != len(mesh.vertices):
        raise SettingsError("scalp hair: the mesh is not of the head model that the settings name")
    region = model.vertex_region
    scalp, skin = (region == VERTEX_REGIONS.index(name) for name in ("scalp", "skin"))
    normal = vertex_normals(mesh.vertices, mesh.triangles)
    x, y = np.floor(r.face.camera.project(mesh.vertices)).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < share.shape[1]) & (y < share.shape[0])
    inside &= (normal * mesh.vertices).sum(axis=1) < 0
    shown = np.zeros(len(region), bool)
    shown[inside] = share[y[inside], x[inside]] > 0.5
    return Hair(scalp | (skin & shown), np.clip(albedo, *_BOUNDS).astype(np.float32))
