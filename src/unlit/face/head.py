"""The head as it was fitted to the photo: what the stages start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.short_repr import short_repr
from ..scene.surface_points import SurfacePoints
from .face import PosedMesh


@dataclass(frozen=True)
class Motion:
    """How the head moves: the head model's expression units, and what the fit found of them.

    names: of E units, ARKit's where a unit is one of them (head/model.py). unit (N,), vertex (N,)
    int32, displacement (N, 3) float32: of the vertices that a unit moves, at full strength, cm,
    model frame. expression: (E,) float32 in [0, 1], that of the photo. rotation (3, 3),
    translation (3,) cm, float64: world = rotation @ model + translation.
    """

    names: tuple[str, ...]
    unit: np.ndarray
    vertex: np.ndarray
    displacement: np.ndarray
    expression: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray

    def of(self, number: int, count: int) -> np.ndarray:
        """Displacement (count, 3) float32 of a mesh of `count` vertices by a unit, model frame."""
        here = self.unit == number
        out = np.zeros((count, 3), np.float32)
        out[self.vertex[here]] = self.displacement[here]
        return out

    __repr__ = short_repr


@dataclass(frozen=True)
class FittedHead:
    """A head before the stages, to which stage 3 holds the mesh (paper, section 3.3).

    mesh: world frame, cm. landmarks: (L, 2) float32, as detected, without the landmarker's mean
    error, pixels of the crop. landmark_points: the same points on the mesh. landmark_residual: mean
    distance between both, in eye distances, model: name and licence of the head model, and motion:
    what moves it; None for a mesh that was not fitted. skin_regions: (V, 8) float32 in [0, 1], sum
    1, weights of the vertices (head/skin_regions.py); None where nothing is known of regions.
    """

    mesh: PosedMesh
    landmarks: np.ndarray
    landmark_points: SurfacePoints
    landmark_residual: float | None = None
    model: str | None = None
    motion: Motion | None = None
    skin_regions: np.ndarray | None = None

    __repr__ = short_repr

    @staticmethod
    def of_mesh(vertices: np.ndarray, triangles: np.ndarray, landmarks: np.ndarray) -> FittedHead:
        """A bare mesh (V, 3), (F, 3), as where the true one is known: no layout, no landmarks."""
        mesh = PosedMesh(
            vertices.astype(np.float32),
            triangles.astype(np.int32),
            np.zeros((1, 2), np.float32),
            np.zeros((len(triangles), 3), np.int32),
        )
        detected = np.asarray(landmarks[:, :2], np.float32)
        return FittedHead(mesh, detected, SurfacePoints.empty(len(detected)))
