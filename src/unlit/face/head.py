"""The head as it was fitted to the photo: what the stages start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.short_repr import short_repr
from ..scene.surface_points import SurfacePoints
from .face import PosedMesh


@dataclass(frozen=True)
class FittedHead:
    """A head before the stages, to which stage 3 holds the mesh (paper, section 3.3).

    mesh: world frame, cm. landmarks: (L, 2) float32, as detected, without the landmarker's mean
    error, pixels of the crop. landmark_points: the same points on the mesh. landmark_residual: mean
    distance between both, in eye distances, and model: name and licence of the head model; None for
    a mesh that was not fitted.
    """

    mesh: PosedMesh
    landmarks: np.ndarray
    landmark_points: SurfacePoints
    landmark_residual: float | None = None
    model: str | None = None

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
