"""Points that are carried by the triangles of a mesh, and move with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SurfacePoints:
    """L points on a mesh of F triangles, such as the landmarks on a head.

    triangle: (L,) int32 in [-1, F), the triangle that carries each point, -1 where none does.
    barycentric: (L, 3) float32, weights of that triangle's corners, summing to 1; 0 where none.
    """

    triangle: np.ndarray
    barycentric: np.ndarray

    @staticmethod
    def empty(count: int) -> SurfacePoints:
        """`count` points that no triangle carries."""
        return SurfacePoints(
            np.full(count, -1, dtype=np.int32), np.zeros((count, 3), dtype=np.float32)
        )

    def on(self, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Places (L, 3) on a mesh (V, 3), (F, 3), in its frame and unit; NaN where none."""
        corners = vertices[triangles[self.triangle]]
        points = np.einsum("lc,lcx->lx", self.barycentric, corners)
        points[self.triangle < 0] = np.nan
        return points
