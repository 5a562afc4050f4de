"""Tangents as MikkTSpace makes them, so that other programs read the normal maps as written.

M. S. Mikkelsen, "Simulation of wrinkled surfaces revisited", 2008. A texel (x, y, z) of a normal
map stands for the direction x T + y B + z N with N and T interpolated between the vertices, not
normalised, and B = sign * N x T. The texture coordinates have v up, so that +y points up in the
picture: the convention of OpenGL, glTF and Blender.
"""

from __future__ import annotations

import numpy as np


def tangents(
    position: np.ndarray, normal: np.ndarray, uv: np.ndarray, triangles: np.ndarray
) -> np.ndarray:
    """Tangents (V, 4) float32: unit direction of growing u, perpendicular to the normal; sign.

    position, normal: (V, 3), unit normals. uv: (V, 2), v up. triangles: (F, 3). A vertex has one
    texture coordinate: vertices on a seam are written once for each side (geometry.py).
    """
    p, t = position.astype(np.float64)[triangles], uv.astype(np.float64)[triangles]
    n = normal.astype(np.float64)[triangles]
    d1, d2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    (u1, v1), (u2, v2) = (t[:, 1] - t[:, 0]).T, (t[:, 2] - t[:, 0]).T
    orientation = np.sign(u1 * v2 - u2 * v1)
    along = orientation[:, None] * (v2[:, None] * d1 - v1[:, None] * d2)
    corner = _flattened(along[:, None], n)
    following = _flattened(np.roll(p, -1, axis=1) - p, n)
    preceding = _flattened(np.roll(p, 1, axis=1) - p, n)
    angle = np.arccos(np.clip((following * preceding).sum(axis=-1), -1, 1))
    weighted = (angle[..., None] * corner).reshape(-1, 3)
    turned = (angle * orientation[:, None]).ravel()
    count = len(position)
    total = np.stack([_sums(triangles, weighted[:, i], count) for i in range(3)], axis=-1)
    # Where the layout is degenerate any direction will do, but it must not be zero.
    lost = np.linalg.norm(total, axis=1) < 1e-12
    unit = normal[lost].astype(np.float64)
    total[lost] = np.eye(3)[np.abs(unit).argmin(axis=1)]
    direction = _flattened(total, normal.astype(np.float64))
    sign = np.where(_sums(triangles, turned, count) < 0, -1.0, 1.0)
    return np.concatenate([direction, sign[:, None]], axis=1).astype(np.float32)


def _flattened(vector: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Unit part of `vector` (..., 3) perpendicular to the unit `normal`; 0 where there is none."""
    flat = vector - (vector * normal).sum(axis=-1, keepdims=True) * normal
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    return flat / np.where(length > 1e-20, length, np.inf)


def _sums(triangles: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    return np.bincount(triangles.ravel(), values, count)
