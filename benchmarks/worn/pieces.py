"""What the meshes of this package are made of: materials, sheets, tubes, and the shape of a head.

Everything is made to measure for one head, in that head's frame: right-handed, x to the subject's
left, y up, the face looks along +z, centimetres. Azimuths are angles about the vertical, 0 to the
front, growing towards +x.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

Grid = np.ndarray  # (R, C, 3) points of a sheet, rows by columns
RIGHT_EYE, LEFT_EYE = (33, 133, 159, 145), (263, 362, 386, 374)
NEAR_SKIN = ((0.62, 0.46, 0.34), (0.50, 0.33, 0.24), (0.36, 0.22, 0.15), (0.70, 0.56, 0.45))


@dataclass(frozen=True)
class Piece:
    """One mesh and what it is.

    kind: 'frame', 'clear lens', 'tinted lens', 'cloth' or 'hand'. vertices (V, 3) cm in the head's
    frame; triangles (F, 3), shaded smoothly. material: a Mitsuba BSDF dictionary, right from both
    sides.
    """

    kind: str
    vertices: np.ndarray
    triangles: np.ndarray
    material: dict[str, Any]


def rgb_of(colour: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(c) for c in np.clip(colour, 0, 1)]}


def two_sided(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": bsdf}


def matte(colour: Any) -> dict[str, Any]:
    return two_sided({"type": "diffuse", "reflectance": rgb_of(colour)})


def metal_bsdf(colour: Any, alpha: float) -> dict[str, Any]:
    return two_sided(
        {
            "type": "roughconductor",
            "material": "none",
            "alpha": float(alpha),
            "specular_reflectance": rgb_of(colour),
        }
    )


def plastic_bsdf(colour: Any, alpha: float) -> dict[str, Any]:
    return two_sided(
        {"type": "roughplastic", "alpha": float(alpha), "diffuse_reflectance": rgb_of(colour)}
    )


def masked(bsdf: dict[str, Any], opacity: float) -> dict[str, Any]:
    return {"type": "mask", "opacity": float(opacity), "bsdf": bsdf}


def cloth_colour(rng: np.random.Generator) -> np.ndarray:
    """Linear sRGB of a cloth: often white, black or grey, now and then as skin, else any hue."""
    kind = rng.choice(["skin", "white", "black", "grey", "hue"], p=[0.16, 0.14, 0.18, 0.12, 0.4])
    if kind == "skin":
        return np.array(NEAR_SKIN[rng.integers(len(NEAR_SKIN))]) * rng.uniform(0.75, 1.2)
    if kind == "hue":
        hue, saturation, value = rng.random(), rng.uniform(0.3, 0.95), rng.uniform(0.15, 0.8)
        return np.array(colorsys.hsv_to_rgb(hue, saturation, value)) ** 1.6
    low, high = {"white": (0.65, 0.85), "black": (0.015, 0.04), "grey": (0.1, 0.45)}[kind]
    return rng.uniform(low, high) * rng.uniform(0.93, 1.07, 3)


def faces_of(rows: int, columns: int, wrap: bool) -> np.ndarray:
    """Triangles (R', C', 2, 3) of a grid of points; the last column joins the first if `wrap`."""
    row = np.arange(rows - 1)[:, None]
    column = np.arange(columns if wrap else columns - 1)[None]
    after = (column + 1) % columns
    a, b = row * columns + column, row * columns + after
    c, d = a + columns, b + columns
    return np.stack([np.stack([a, c, b], -1), np.stack([b, c, d], -1)], axis=2)


def piece_of(
    kind: str, vertices: np.ndarray, triangles: np.ndarray, material: dict[str, Any]
) -> Piece:
    """A piece without triangles of no area, and without vertices that none needs."""
    triangles = triangles.reshape(-1, 3)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    triangles = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-8]
    used, index = np.unique(triangles, return_inverse=True)
    packed = np.ascontiguousarray(vertices[used], dtype=np.float32)
    return Piece(kind, packed, index.reshape(-1, 3).astype(np.int32), material)


def joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of several meshes in one."""
    start = np.cumsum([0] + [len(v) for v, _ in parts])
    triangles = [t.reshape(-1, 3) + s for (_, t), s in zip(parts, start, strict=False)]
    return np.concatenate([v for v, _ in parts]), np.concatenate(triangles)


def sheet_mesh(grid: Grid, wrap: bool) -> tuple[np.ndarray, np.ndarray]:
    return grid.reshape(-1, 3), faces_of(grid.shape[0], grid.shape[1], wrap)


def slab_mesh(grid: Grid, thickness: float, wrap: bool) -> tuple[np.ndarray, np.ndarray]:
    """A sheet (R, C, 3) of some thickness (cm, along y): top, bottom and sharp edges all round."""
    below = grid - np.array([0, thickness, 0])
    edges = [(grid[-1], below[-1]), (grid[0], below[0])]
    if not wrap:
        edges += [(grid[:, 0], below[:, 0]), (grid[:, -1], below[:, -1])]
    closed = [sheet_mesh(np.stack(pair), wrap and i < 2) for i, pair in enumerate(edges)]
    return joined([sheet_mesh(grid, wrap), sheet_mesh(below, wrap), *closed])


def tube_mesh(
    path: np.ndarray,
    wide: np.ndarray,
    deep: np.ndarray,
    half: tuple[Any, Any],
    closed: bool = False,
    power: float = 2.0,
) -> tuple[np.ndarray, np.ndarray]:
    """A tube along path (N, 3); its cross-section is a superellipse of half-axes `half`.

    wide, deep: unit directions (N, 3) or (3,) of the half-axes, cm, which are numbers or (N,).
    """
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    along = [np.sign(f) * np.abs(f) ** (2 / power) for f in (np.cos(angle), np.sin(angle))]
    wide, deep = (np.broadcast_to(d, path.shape) for d in (wide, deep))
    a, b = (np.broadcast_to(np.asarray(h, float), len(path))[:, None, None] for h in half)
    rows = a * along[0][None, :, None] * wide[:, None]
    rows = path[:, None] + rows + b * along[1][None, :, None] * deep[:, None]
    if closed:
        rows = np.concatenate([rows, rows[:1]])
    else:
        ends = [np.repeat(path[i][None, None], 16, axis=1) for i in (0, -1)]
        rows = np.concatenate([ends[0], rows, ends[1]])
    return sheet_mesh(rows, wrap=True)


def cloth_pieces(
    grid: Grid, wrap: bool, rng: np.random.Generator, colour: np.ndarray
) -> list[Piece]:
    """A sheet of cloth; sometimes striped or checked, which is two pieces."""
    vertices, faces = sheet_mesh(grid, wrap)
    kind = rng.choice(["plain", "stripes", "bars", "checks"], p=[0.76, 0.1, 0.06, 0.08])
    if kind == "plain":
        return [piece_of("cloth", vertices, faces, matte(colour))]
    row, column = np.indices(faces.shape[:2])
    down, across = row // rng.integers(2, 6), column // rng.integers(4, 10)
    odd = {"stripes": down, "bars": across, "checks": down + across}[kind] % 2 == 1
    other = cloth_colour(rng)
    pair = [(~odd, colour), (odd, other)]
    return [piece_of("cloth", vertices, faces[m], matte(c)) for m, c in pair if m.any()]


def wave_field(rng: np.random.Generator, azimuth: np.ndarray, along: np.ndarray, fold: int) -> Any:
    """Smooth noise of about unit size on azimuths (rad) and `along`, with up to `fold` folds."""
    total = 0.0
    for _ in range(6):
        turns, slope = rng.integers(1, fold + 1), rng.normal(0, 2.5)
        total = total + np.cos(turns * azimuth + slope * along + rng.uniform(0, 2 * np.pi))
    return np.asarray(total) / 2.0


def softened(values: np.ndarray, down: float, around: float) -> np.ndarray:
    """Blur (R, C) by sigmas in rows and in columns, of which the last meets the first."""
    values = ndimage.gaussian_filter1d(values, down, axis=0, mode="nearest")
    return ndimage.gaussian_filter1d(values, around, axis=1, mode="wrap")


def hull_of(points: np.ndarray, most: int = 700) -> np.ndarray:
    """Planes (F, 4) of the convex hull of points (N, 3); normals point outwards."""
    points = points[:: max(1, len(points) // most)].astype(np.float64)
    return np.unique(ConvexHull(points).equations.round(4), axis=0)


def reach_of(planes: np.ndarray, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """How far (...,) a hull reaches from an origin (3,) inside it along directions (..., 3)."""
    gap = np.maximum(-(planes[:, :3] @ origin) - planes[:, 3], 1e-3)
    inverse = directions.astype(np.float32) @ (planes[:, :3] / gap[:, None]).T.astype(np.float32)
    return 1 / np.maximum(inverse.max(axis=-1), 1e-3).astype(np.float64)


def level_at(azimuth: np.ndarray) -> np.ndarray:
    """Horizontal unit directions (..., 3) of azimuths."""
    return np.stack([np.sin(azimuth), np.zeros_like(azimuth), np.cos(azimuth)], axis=-1)


def around_at(values: np.ndarray, at: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Interpolate `values` given at azimuths `at` (N,), any order, to others, all round."""
    order = np.argsort(at)
    return np.interp(azimuth, at[order], values[order], period=2 * np.pi)
