"""The face itself, apart from the photo and its light: what a renderer needs of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.camera import Camera
from ..scene.maps import Maps
from ..scene.short_repr import short_repr


@dataclass(frozen=True)
class PosedMesh:
    """The head's triangles where the photo shows them, world frame, centimetres.

    vertices: (V, 3) float32. triangles: (F, 3) int32, counter-clockwise seen from outside.
    uv: (T, 2) float32 in [0, 1], v up. triangle_uv: (F, 3) int32 into uv.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    triangle_uv: np.ndarray

    __repr__ = short_repr


@dataclass(frozen=True)
class Normals:
    """Unit normals (S, S, 3) float32, world frame; zero outside the mask (paper, section 3.4).

    specular: the mesh's plus the maps' perturbation. diffuse: the same, blurred.
    """

    specular: np.ndarray
    diffuse: np.ndarray

    __repr__ = short_repr


@dataclass(frozen=True)
class Face:
    """A relightable face. Its maps and normals have one texel per pixel of `camera`, S x S.

    mask: (S, S) float32 in [0, 1], where the maps are measured, not filled in.
    """

    camera: Camera
    mesh: PosedMesh
    maps: Maps
    normals: Normals
    mask: np.ndarray

    __repr__ = short_repr
