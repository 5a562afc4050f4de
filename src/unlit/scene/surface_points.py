"""Points fixed on a mesh, by the triangle that carries each and its place there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SurfacePoints:
    """triangle: (L,) int32, -1 where the mesh has no such point. barycentric: (L, 3) float32,
    weights of that triangle's corners, which sum to 1.
    """

    triangle: np.ndarray
    barycentric: np.ndarray

    @staticmethod
    def empty(count: int) -> SurfacePoints:
        """`count` points, none of which the mesh has."""
        return SurfacePoints(np.full(count, -1, np.int32), np.zeros((count, 3), np.float32))
