"""The clear front of an eye: a bulge over the iris, and a film of tears over what lids leave free.

Over the angle t from the eye's axis the surface lies b(t) above the eyeball, with the iris' rim at
t0 and b(t) = B (1 - (t / 1.1 t0)^2)^2. It joins the ball smoothly, and in its middle it is bent as
a cornea is, with a radius of some 8 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .eyes import Eye

#: Height of the bulge, and of the film over the ball: it is not to meet the lids, cm.
BULGE, FILM = 0.06, 0.004
#: Where the bulge ends, of the angle of the iris' rim, and where the film does, radians.
_END, _FILM_END = 1.1, 1.25
_SPLITS = 2


@dataclass(frozen=True)
class Cornea:
    """corners: (N, 3) rows of the eyeball's corners, of which weights (N, 3) make each vertex.

    position: (N, 3) cm, as the eye's. normal: (N, 3) unit. triangles: (F, 3).
    """

    corners: np.ndarray
    weights: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    triangles: np.ndarray


def bulge(eye: Eye, angle: np.ndarray) -> np.ndarray:
    """Height over the ball, cm, at an angle from the eye's axis, radians."""
    return BULGE * np.clip(1 - (angle / (_END * eye.rim)) ** 2, 0, 1) ** 2


def surface_over(eye: Eye, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) from the eye's middle, cm, and unit normal (N, 3), of the clear surface.

    direction: (N, 3) unit, from the middle.
    """
    angle = np.arccos(np.clip(direction @ eye.axis, -1, 1))
    height = eye.radius + FILM + bulge(eye, angle)
    # The normal of a surface of revolution: the ray from the centre, leant by the height's slope.
    step = 1e-4
    slope = (bulge(eye, angle + step) - bulge(eye, np.maximum(angle - step, 0))) / (2 * step)
    out = direction - eye.axis * (direction @ eye.axis)[:, None]
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    along = out * np.cos(angle)[:, None] - eye.axis * np.sin(angle)[:, None]
    normal = direction - along * (slope / height)[:, None]
    return height, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def cornea(eye: Eye, position: np.ndarray, triangles: np.ndarray) -> Cornea:
    """Of the eyeball with corners at `position` (W, 3), cm, world frame; triangles: (F, 3)."""
    unit = (position - eye.centre) / np.linalg.norm(position - eye.centre, axis=1, keepdims=True)
    angle = np.arccos(np.clip(unit @ eye.axis, -1, 1))
    front = triangles[(angle[triangles] < _FILM_END).all(axis=1)]
    n = 1 << _SPLITS
    steps = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    number = {step: k for k, step in enumerate(steps)}
    inner = []
    for i, j in steps:
        if i + j < n:
            inner.append((number[i, j], number[i + 1, j], number[i, j + 1]))
        if i + j < n - 1:
            inner.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]))
    share = np.array([(n - i - j, i, j) for i, j in steps]) / n
    weights = np.tile(share, (len(front), 1))
    corners = np.repeat(front, len(steps), axis=0)
    split = np.array(inner) + (np.arange(len(front)) * len(steps))[:, None, None]
    corners, weights, where = _joined(corners, weights)
    direction = (weights[..., None] * unit[corners]).sum(axis=1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    height, normal = surface_over(eye, direction)
    position = eye.centre + direction * height[:, None]
    return Cornea(corners, weights, position, normal, where[split].reshape(-1, 3))


def _joined(corners: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the triangles' grids, each once, and the number of every one (N,) among them."""
    order = corners.argsort(axis=1)
    corners = np.take_along_axis(corners, order, axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    # Points on a side are named by its two ends alone, at an end by that.
    named = np.where(weights > 0, corners, -1)
    keys = np.concatenate([named, np.rint(weights * (1 << _SPLITS)).astype(int)], axis=1)
    # -1 in different columns would tell equal points apart: sort what counts to the front.
    front = (-(weights > 0).astype(int)).argsort(axis=1, kind="stable")
    keys = np.concatenate(
        [np.take_along_axis(keys[:, :3], front, 1), np.take_along_axis(keys[:, 3:], front, 1)], 1
    )
    _, first, where = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return corners[first], weights[first], where.ravel()
