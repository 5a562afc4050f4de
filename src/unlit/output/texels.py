"""The texels of a layout, and the points of the mesh that their centres show."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import where
from ..scene.mesh import Mesh
from .geometry import Welded

mi = mitsuba()


@dataclass(frozen=True)
class Texels:
    """The K texels whose centre lies in a triangle of the layout, row-major.

    index: (K,) row-major number. triangle: (K,). weights: (K, 3) barycentric, float32.
    """

    index: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray

    def some(self, rows: np.ndarray | slice) -> Texels:
        """Those of the given rows: numbers (M,), a mask (K,), or a slice."""
        return Texels(self.index[rows], self.triangle[rows], self.weights[rows])

    def at(self, values: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Values (W, C) of the vertices of `triangles` (F, 3), interpolated: (K, C)."""
        corners = triangles[self.triangle]
        return sum(self.weights[:, i : i + 1] * values[corners[:, i]] for i in range(3))  # type: ignore[return-value]


def texels_of(mesh: Welded, size: int) -> Texels:
    """Rasterise the layout of `mesh` in `size` x `size` texels, row 0 at v = 1.

    Rays straight down on the triangles laid out flat in (u, v). Where the layout overlaps itself,
    the triangle with most surface per texel lies on top.
    """
    a, b, c = (mesh.position[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    surface_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    a, b, c = (mesh.uv[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    density = surface_area / np.maximum(np.abs(_cross(b - a, c - a)), 1e-16)
    height = density.argsort().argsort() / len(density)
    flat = np.concatenate([mesh.uv[mesh.triangles.ravel()], np.repeat(height, 3)[:, None]], axis=1)
    scene = Mesh(flat, np.arange(len(flat), dtype=np.int32).reshape(-1, 3)).scene
    pixel = dr.arange(mi.UInt32, size * size)
    side = dr.opaque(mi.UInt32, size)
    u = (mi.Float(pixel % side) + 0.5) / mi.Float(side)
    v = 1 - (mi.Float(pixel // side) + 0.5) / mi.Float(side)
    hit = scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(u, v, 2), mi.Vector3f(0, 0, -1)))
    index = where(hit.is_valid())
    triangle = dr.gather(mi.UInt32, hit.prim_index, index).numpy().astype(np.int32)
    index = index.numpy().astype(np.int64)
    at = np.stack([(index % size + 0.5) / size, 1 - (index // size + 0.5) / size], axis=1)
    a, b, c = a[triangle], b[triangle], c[triangle]
    area = _cross(b - a, c - a)
    area = np.where(np.abs(area) > 1e-16, area, 1e-16)
    second, third = _cross(at - a, c - a) / area, _cross(b - a, at - a) / area
    weights = np.stack([1 - second - third, second, third], axis=1)
    return Texels(index, triangle, weights.astype(np.float32))


def centimetres_per_texel(mesh: Welded, size: int) -> np.ndarray:
    """Length (F,), cm, of what a texel of each triangle covers, along the longer way."""
    a, b, c = (mesh.position[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    p, q = b - a, c - a
    a, b, c = (mesh.uv[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    s, t = b - a, c - a
    area = _cross(s, t)
    area = np.where(np.abs(area) > 1e-16, area, 1e-16)[:, None]
    along_u, along_v = (p * t[:, 1:] - q * s[:, 1:]) / area, (q * s[:, :1] - p * t[:, :1]) / area
    e, f, g = (
        (x * y).sum(axis=1) for x, y in ((along_u, along_u), (along_u, along_v), (along_v, along_v))
    )
    return np.sqrt(0.5 * (e + g + np.sqrt((e - g) ** 2 + 4 * f**2))) / size


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
