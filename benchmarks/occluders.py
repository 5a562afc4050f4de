"""What stands between the sun and a face, as objects of a Mitsuba scene: a brim, hair, leaves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dressed import curves, smooth_mesh
from worn.pieces import joined, matte, rgb_of, slab_mesh, tube_mesh

_BROWS, _EYES = (105, 334), ((33, 133), (362, 263))
_TEMPLES = (127, 356)

Objects = dict[str, Any]


def brim(points: np.ndarray, _: np.ndarray) -> Objects:
    """A cap's visor: half a disc, 6 cm deep, above the brows. points: landmarks (478, 3), cm."""
    middle = points[list(_BROWS)].mean(axis=0) + np.array([0, 2.8, -7.5])
    angle = np.radians(np.linspace(-80, 80, 60))[:, None]
    radius = np.linspace(8.0, 14.0, 8)[None]
    flat = np.stack([radius * np.sin(angle), 0 * radius * angle, radius * np.cos(angle)], axis=-1)
    flat[..., 1] -= 0.12 * (flat[..., 2] - 8)
    return {"brim": _body("brim", *slab_mesh(middle + flat, 0.15, wrap=False), (0.05, 0.07, 0.12))}


def strands(points: np.ndarray, _: np.ndarray) -> Objects:
    """Locks that hang over the forehead and one cheek, half a centimetre before the skin."""
    rng = np.random.default_rng(3)
    top = points[10] + (0, 2.5, 0.3)
    rows = []
    for _lock in range(14):
        x = rng.uniform(-5.5, 5.5)
        length, lean = rng.uniform(4.0, 8.0), rng.normal(0, 0.25)
        for _strand in range(14):
            t = np.linspace(0, 1, 12)
            side = x + rng.normal(0, 0.12) + (lean * t + 0.15 * np.sin(5 * t + x)) * length * 0.4
            depth = 0.7 - 0.045 * side**2 - 1.2 * (1 - t) ** 2 + rng.normal(0, 0.06)
            path = np.stack([top[0] + side, top[1] - t * length, top[2] + depth], axis=-1)
            rows.append(np.column_stack([path, np.linspace(0.012, 0.006, 12)]))
    hair = {"type": "principled", "base_color": rgb_of((0.06, 0.035, 0.02)), "roughness": 0.4}
    return {"strands": curves(np.stack(rows), hair)}


def frames(points: np.ndarray, _: np.ndarray) -> Objects:
    """Spectacle frames without lenses."""
    parts = []
    rims = []
    for outer, inner in _EYES:
        middle = points[[outer, inner]].mean(axis=0) + np.array([0, -0.3, 1.3])
        angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        out = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        path = middle + out * (2.5, 2.0, 1)
        parts.append(tube_mesh(path, out, np.array([0.0, 0, 1]), (0.15, 0.12), closed=True))
        rims.append(middle)
    left, right = sorted(rims, key=lambda p: p[0])
    inwards = np.array([2.5, 0.2, 0])
    bridge = np.linspace(left + inwards, right + inwards * (-1, 1, 1), 6)
    up, deep = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
    parts.append(tube_mesh(bridge, up, deep, (0.15, 0.12)))
    for rim, temple, side in ((left, 0, -1), (right, 1, 1)):
        end = points[_TEMPLES[temple]] + (0.6 * side, 0.3, -4)
        arm = np.linspace(rim + np.array([2.5 * side, 0.3, 0]), end, 8)
        parts.append(tube_mesh(arm, up, np.array([1.0, 0, 0]), (0.15, 0.1)))
    return {"frames": _body("frames", *joined(parts), (0.02, 0.02, 0.02))}


def leaves(points: np.ndarray, sun: np.ndarray) -> Objects:
    """A branch 35 to 60 cm towards the sun, which hides about a third of it."""
    rng = np.random.default_rng(5)
    middle = np.nanmean(points, axis=0)
    across = np.cross(sun, (0, 1, 0.1))
    across /= np.linalg.norm(across)
    up = np.cross(across, sun)
    parts = []
    for _leaf in range(26):
        centre = middle + sun * rng.uniform(35, 60) + across * rng.uniform(-11, 11)
        centre = centre + up * rng.uniform(-12, 12)
        turn = rng.uniform(0, np.pi)
        long = np.cos(turn) * across + np.sin(turn) * up
        wide = np.cross(sun, long)
        t = np.linspace(-1, 1, 14)[:, None]
        s = np.linspace(-1, 1, 5)[None] * np.sqrt(np.maximum(1 - t**2, 0))
        size = rng.uniform(1.5, 3.0)
        grid = centre + size * (t[..., None] * long + 0.5 * s[..., None] * wide)
        parts.append(slab_mesh(grid, 0.02, wrap=False))
    return {"leaves": _body("leaves", *joined(parts), (0.05, 0.12, 0.03))}


def _body(name: str, vertices: np.ndarray, triangles: np.ndarray, colour: Any) -> Any:
    return smooth_mesh(name, matte(colour), vertices, triangles.reshape(-1, 3))


#: By name: of landmarks (478, 3), cm, in the camera's frame, and the direction (3,) of the sun.
KINDS: dict[str, Callable[[np.ndarray, np.ndarray], Objects]] = {
    "brim": brim,
    "strands": strands,
    "frames": frames,
    "leaves": leaves,
}
