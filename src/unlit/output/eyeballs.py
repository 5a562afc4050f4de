"""Where to look for an eyeball that the photo hides: at the other one."""

from __future__ import annotations

import numpy as np

from ..scene.components import components
from .geometry import Welded
from .parts import EYES

#: An eye of which less than this was seen, of the other's, is taken from the other.
_LEAST = 0.25


def borrowed(mesh: Welded, part: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (W, 3) of the mesh's corners to look at, and which are moved, (W,) bool.

    The corners of an eyeball that was not seen lie on the other one, in the same direction from
    its middle, as both eyes look the same way. part: (F,). seen: (W,) bool.
    """
    position, moved = mesh.position.copy(), np.zeros(len(mesh.position), bool)
    eyes = np.unique(mesh.triangles[part == EYES])
    if not eyes.size:
        return position, moved
    vertices = mesh.vertex[mesh.triangles]
    piece = components(vertices, int(mesh.vertex.max()) + 1)[mesh.vertex[eyes]]
    balls = [eyes[piece == number] for number in np.unique(piece)]
    if len(balls) != 2:
        return position, moved
    for own, other in (balls, balls[::-1]):
        if seen[own].sum() < _LEAST * seen[other].sum():
            (a, r), (b, s) = (_ball(mesh.position[corners]) for corners in (own, other))
            position[own], moved[own] = b + (mesh.position[own] - a) * (s / r), True
    return position, moved


def _ball(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Middle and radius."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle, float(np.linalg.norm(points - middle, axis=1).mean())
