"""Vertex normals in NumPy: for head models, subjects and files, where nothing is differentiated.

scene/mesh.py has their differentiable twin, which the renderers shade with.
"""

from __future__ import annotations

import numpy as np


def vertex_normals(
    vertices: np.ndarray, triangles: np.ndarray, point: np.ndarray | None = None
) -> np.ndarray:
    """Unit vertex normals (V, 3), float64: the triangles' normals around each, weighted by area.

    vertices: (V, 3), any unit. triangles: (F, 3), counter-clockwise from outside. point: (V,) index
    of the point that each vertex lies on, where seams of texture coordinates split some; vertices
    of one point share its normal. A vertex of no triangle gets zero.
    """
    corner = triangles if point is None else point[triangles]
    a, b, c = (vertices[triangles[:, k]].astype(np.float64) for k in range(3))
    face = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    count = len(vertices) if point is None else int(point.max()) + 1
    total = np.stack([np.bincount(corner.ravel(), face[:, k], count) for k in range(3)], axis=1)
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)
    return total if point is None else total[point]
