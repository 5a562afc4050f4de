"""Which triangles are skin, which are eyeballs, which teeth, which line the inside of the head.

Read off the geometry alone, so that any head model will do. A chart (a connected part of the
texture layout) from which almost nothing of the outside can be seen lines the mouth or an eye
socket: measured on fitted heads, 0.00 to 0.02 of its hemisphere is free, on skin more than 0.9.
A piece of the mesh other than the largest that is round is an eyeball, one that is bent around an
empty middle is a row of teeth with its gums; a tongue is neither, and counts as inside.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import KDTree

from ..machine.runtime import mitsuba
from ..scene.components import components

SKIN, EYES, INSIDE, TEETH = range(4)
#: Names of the parts, used for the materials of the files.
PARTS = ("skin", "eyes", "inside", "teeth")

_OPEN = 0.2  # share of the hemisphere that is free, under which a chart is inside
# Of a piece's points the least distance from its box's middle over the greatest: eyeballs have 1,
# rows of teeth .37, a tongue .06. And the greatest cosine, seen from there, of a point with the
# axis along which the piece is thinnest: what is closed has 1, rows of teeth .33.
_ROUND, _HOLLOW, _BOW = 0.9, 0.2, 0.8
_RAYS = 32


def parts(vertices: np.ndarray, triangles: np.ndarray, triangle_uv: np.ndarray) -> np.ndarray:
    """Index into PARTS of each triangle: (F,) uint8.

    vertices: (V, 3), cm. triangles, triangle_uv: (F, 3) into vertices and texture coordinates.
    """
    chart = _connected(triangle_uv)
    weight, free = _openness(vertices, triangles)
    open_charts = np.bincount(chart, weight * free) >= _OPEN * np.bincount(chart, weight)
    part = np.where(open_charts[chart], SKIN, INSIDE).astype(np.uint8)
    piece = _connected(triangles)
    sizes = np.bincount(piece)
    for index in np.flatnonzero(sizes < sizes.max()):
        inside = piece == index
        points = vertices[np.unique(triangles[inside])]
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = np.linalg.norm(points - centre, axis=1)
        hollow = radius.min() / radius.max()
        thinnest = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][-1]
        if hollow > _ROUND:
            part[inside] = EYES
        elif hollow > _HOLLOW and np.abs((points - centre) @ thinnest / radius).max() < _BOW:
            part[inside] = TEETH
    return part


def parts_of_corners(triangles: np.ndarray, part: np.ndarray, count: int) -> np.ndarray:
    """The part of each of `count` corners, (W,) uint8; INSIDE where no triangle has it.

    triangles: (F, 3) into them. part: (F,).
    """
    found = np.full(count, INSIDE, dtype=np.uint8)
    for one in (SKIN, EYES, TEETH):
        found[np.unique(triangles[part == one])] = one
    return found


def mirror_axis(uv: np.ndarray, triangle_uv: np.ndarray) -> float | None:
    """The u about which the layout's largest chart is its own mirror image, or None.

    triangle_uv: (F, 3) of the skin.
    """
    chart = components(triangle_uv, len(uv))
    points = uv[chart == np.bincount(chart).argmax()]
    axis = float(points[:, 0].min() + points[:, 0].max()) / 2
    distance = KDTree(points).query(points * (-1, 1) + (2 * axis, 0))[0]
    return axis if np.percentile(distance, 99) < 3e-3 else None


def _connected(triangles: np.ndarray) -> np.ndarray:
    """Number of the connected component of each triangle, (F,) from 0."""
    component = components(triangles, int(triangles.max()) + 1)
    return np.unique(component[triangles[:, 0]], return_inverse=True)[1]


def _openness(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Area (F,) and cosine-weighted share of free sky (F,) in [0, 1] of each triangle."""
    from ..scene.arrays import device
    from ..scene.mesh import Mesh

    mi = mitsuba()
    a, b, c = (vertices[triangles[:, i]].astype(np.float64) for i in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-30)[:, None]
    # Spiral points on the disc, lifted to the hemisphere, are spread by the cosine.
    squared = (np.arange(_RAYS) + 0.5) / _RAYS
    angle = np.arange(_RAYS) * np.pi * (3 - np.sqrt(5))
    x, y = np.sqrt(squared) * np.cos(angle), np.sqrt(squared) * np.sin(angle)
    local = np.stack([x, y, np.sqrt(1 - squared)], axis=1)
    start = (a + b + c) / 3 + 1e-3 * normal

    def rays(rows: np.ndarray, kind: Any) -> Any:
        return device(kind, np.repeat(rows, _RAYS, axis=0))

    frame = mi.Frame3f(rays(normal, mi.Vector3f))
    towards = frame.to_world(device(mi.Vector3f, np.tile(local, (len(triangles), 1))))
    hit = Mesh(vertices, triangles).scene.ray_test(mi.Ray3f(rays(start, mi.Point3f), towards))
    return area, 1 - hit.numpy().reshape(-1, _RAYS).mean(axis=1)
