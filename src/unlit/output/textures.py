"""The atlas as picture files.

PNG, 8 bits (displacement: 16), for programs that want textures:

    atlas_diffuse_albedo.png        sRGB-encoded, clipped at 1
    atlas_specular_albedo.png       0 to 2 as 0 to 255
    atlas_perceptual_roughness.png  square root of the Beckmann alpha, 0 to 1 as 0 to 255
    atlas_specular_normal.png       tangent space, -1 to 1 as 0 to 255, y up (or down: DirectX)
    atlas_diffuse_normal.png        the same
    atlas_displacement.png          mm over the mesh: -5 to 5 as 0 to 65535
    atlas_confidence.png            the five levels of atlas.py, 0 to 255

EXR, float32, linear, for renderers: atlas_diffuse_albedo, atlas_specular_albedo, atlas_roughness
(the Beckmann alpha), both normals, -1 to 1 as 0 to 1, y always up, and atlas_displacement, mm.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .images import bytes_of, encoded, height_levels

if TYPE_CHECKING:
    from .atlas import Atlas

ALBEDO = "atlas_diffuse_albedo.png"
SPECULAR = "atlas_specular_albedo.png"
ROUGHNESS = "atlas_perceptual_roughness.png"
NORMAL = "atlas_specular_normal.png"
DIFFUSE_NORMAL = "atlas_diffuse_normal.png"
DISPLACEMENT = "atlas_displacement.png"
CONFIDENCE = "atlas_confidence.png"


def perceptual_roughness(alpha: np.ndarray) -> np.ndarray:
    """uint8 of the roughness that glTF, Blender and Unreal square to get alpha."""
    return bytes_of(np.sqrt(alpha))


def normal_bytes(normal: np.ndarray, directx: bool = False) -> np.ndarray:
    """(N, N, 3) uint8 of tangent-space unit normals (N, N, 3); DirectX has y down."""
    return bytes_of(0.5 + 0.5 * normal * (1, -1 if directx else 1, 1))


#: By file name: the pixels, uint8 or uint16, given the atlas and whether y of the normals is to
#: point down.
PNGS: dict[str, Callable[[Atlas, bool], np.ndarray]] = {
    ALBEDO: lambda atlas, _: encoded(atlas.diffuse_albedo),
    SPECULAR: lambda atlas, _: bytes_of(atlas.specular_albedo / 2),
    ROUGHNESS: lambda atlas, _: perceptual_roughness(atlas.roughness),
    NORMAL: lambda atlas, directx: normal_bytes(atlas.specular_normal, directx),
    DIFFUSE_NORMAL: lambda atlas, directx: normal_bytes(atlas.diffuse_normal, directx),
    DISPLACEMENT: lambda atlas, _: height_levels(atlas.displacement),
    CONFIDENCE: lambda atlas, _: atlas.confidence,
}
#: By file name: the array of the EXR.
EXRS: dict[str, Callable[[Atlas], np.ndarray]] = {
    "atlas_diffuse_albedo.exr": lambda atlas: atlas.diffuse_albedo,
    "atlas_specular_albedo.exr": lambda atlas: atlas.specular_albedo,
    "atlas_roughness.exr": lambda atlas: atlas.roughness,
    "atlas_specular_normal.exr": lambda atlas: 0.5 + 0.5 * atlas.specular_normal,
    "atlas_diffuse_normal.exr": lambda atlas: 0.5 + 0.5 * atlas.diffuse_normal,
    "atlas_displacement.exr": lambda atlas: atlas.displacement,
}


def _map(file: str) -> str:
    """Name of the map that an atlas file holds."""
    return file.partition(".")[0].removeprefix("atlas_").removeprefix("perceptual_")


#: By name of a map: its files.
MAP_FILES = {_map(name): [f for f in (*PNGS, *EXRS) if _map(f) == _map(name)] for name in PNGS}
