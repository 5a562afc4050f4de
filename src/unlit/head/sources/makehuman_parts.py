"""The parts of MakeHuman's base mesh that make the head.

Islands of its texture, and three of its helpers: eyeballs, teeth with their gums, and tongue.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..subdivision import catmull_clark, triangulate
from .makehuman_files import Files

# Islands of the base mesh's texture atlas, by a rectangle (u0, v0, u1, v1) of it that holds the
# island and nothing else of the body, and the rectangle it gets in the head's own atlas. The
# skin is turned upright; the rest is never seen in a photo and shares the strip below.
SKIN, MOUTH, _RIGHT_EYE, _LEFT_EYE, NECK = range(5)
_ISLANDS = (
    (0.641, 0.148, 0.994, 0.818),
    (0.757, 0.011, 0.924, 0.137),
    (0.0118, 0.547, 0.0769, 0.633),
    (0.0861, 0.547, 0.1512, 0.633),
    (0.2488, 0.8688, 0.5123, 0.9739),
)
# The head's island ends at the jaw in front. Of the body's island the quads of the throat and
# nape are kept: those above this height and this close to the middle plane (base mesh units).
_NECK_LOWEST, _NECK_HALF_WIDTH = 5.8, 0.72
_PLACES = (
    (0.004, 0.264, 0.996, 0.996),
    (0.004, 0.004, 0.324, 0.244),
    (0.34, 0.124, 0.43, 0.244),
    (0.44, 0.124, 0.53, 0.244),
    (0.72, 0.004, 0.996, 0.114),
)
# The same of upper teeth, lower teeth and tongue, one after another in Files.mouth_quads.
_MOUTH_ISLANDS = (
    (0.678, 0.8755, 0.7385, 0.8978),
    (0.678, 0.8978, 0.7385, 0.92),
    (0.6229, 0.9294, 0.6478, 0.9841),
)
_TONGUE = 2
_MOUTH_PLACES = (
    (0.34, 0.004, 0.52, 0.114),
    (0.53, 0.004, 0.71, 0.114),
    (0.55, 0.124, 0.7, 0.244),
)
EYEBALL_PLACES = ((0.72, 0.124, 0.84, 0.244), (0.85, 0.124, 0.97, 0.244))
EYEBALL_HELPERS = (slice(14670, 14742), slice(14598, 14670))  # right, left
_EYEBALL_RINGS, _EYEBALL_SECTORS = 20, 32


def islands(source: Files) -> np.ndarray:
    """Index into _ISLANDS of the texture island each quad (Q,) belongs to, -1 for the body's."""
    sides = np.stack([source.quad_uv, np.roll(source.quad_uv, -1, axis=1)], axis=-1).reshape(-1, 2)
    count = len(source.uv)
    graph = sp.coo_matrix((np.ones(len(sides)), sides.T), shape=(count, count))
    label = connected_components(graph, directed=False)[1][source.quad_uv[:, 0]]
    island = np.full(len(source.quads), -1)
    for one in np.unique(label):
        corners = source.uv[source.quad_uv[label == one]].reshape(-1, 2)
        for index, (u0, v0, u1, v1) in enumerate(_ISLANDS):
            if (corners >= (u0, v0)).all() and (corners <= (u1, v1)).all():
                island[label == one] = index
    body = source.positions[source.quads[island < 0]]
    near = (body[..., 1] > _NECK_LOWEST) & (np.abs(body[..., 0]) < _NECK_HALF_WIDTH)
    island[np.flatnonzero(island < 0)[near.all(axis=1)]] = NECK
    if set(range(len(_ISLANDS))) - set(island):
        raise ValueError("the base mesh lacks an island of the head's texture")
    return island


def head_uv(uv: np.ndarray, island: np.ndarray) -> np.ndarray:
    """Texture coordinates (N, 2), each moved with its island (N,) from body's to head's atlas."""
    placed = np.empty_like(uv)
    for index, (source, goal) in enumerate(zip(_ISLANDS, _PLACES, strict=True)):
        inside = island == index
        unit = _within(source, uv[inside])
        if index == SKIN:  # lies on its side: u runs from the crown to the neck
            unit = np.stack([unit[:, 1], 1 - unit[:, 0]], axis=-1)
        placed[inside] = _placed(unit, goal)
    return placed


def _within(box: Sequence[float], uv: np.ndarray) -> np.ndarray:
    """uv (N, 2) in units of the box (u0, v0, u1, v1)."""
    low, high = np.array(box).reshape(2, 2)
    return np.asarray((uv - low) / (high - low))


def _placed(unit: np.ndarray, box: Sequence[float]) -> np.ndarray:
    """What `_within` undoes."""
    low, high = np.array(box).reshape(2, 2)
    return np.asarray(low + unit * (high - low))


class Mouth:
    """Teeth, gums and tongue, refined once: what stands in the mouth, and hangs on nothing.

    quads: (Q, 4) into their own N vertices. quad_uv: (Q, 4) into uv (T, 2) float32 of the head's
    atlas. is_teeth: (N,) bool, of both rows and their gums.
    """

    def __init__(self, source: Files) -> None:
        self._coarse, quads = np.unique(source.mouth_quads, return_inverse=True)
        self._refining, self.quads = catmull_clark(quads.reshape(-1, 4), len(self._coarse))
        self._count = int(self.quads.max()) + 1
        kept, quads = np.unique(source.mouth_quad_uv, return_inverse=True)
        refining, self.quad_uv = catmull_clark(quads.reshape(-1, 4), len(kept), smooth=False)
        uv = refining @ source.uv[kept]
        self.uv = np.empty_like(uv, dtype=np.float32)
        island = np.full(len(uv), -1)
        for index, (box, goal) in enumerate(zip(_MOUTH_ISLANDS, _MOUTH_PLACES, strict=True)):
            unit = _within(box, uv)
            inside = ((unit >= 0) & (unit <= 1)).all(axis=1)
            self.uv[inside] = _placed(unit[inside], goal)
            island[inside] = index
        if set(island) != set(range(len(_MOUTH_ISLANDS))):
            raise ValueError("the base mesh has no teeth and tongue where they are expected")
        self.is_teeth = np.zeros(len(self), dtype=bool)
        self.is_teeth[self.quads] = island[self.quad_uv] != _TONGUE

    def __len__(self) -> int:
        return self._count

    def refined(self, coarse: np.ndarray) -> np.ndarray:
        """Vertices (N, 3) of base mesh positions (or displacements) (V, 3)."""
        return np.asarray(self._refining @ coarse[self._coarse])


@dataclass(frozen=True)
class Eyeball:
    """A sphere that follows MakeHuman's eyeball helper `helper` (a slice of its vertices)."""

    helper: slice
    directions: np.ndarray  # (N, 3) unit

    def moved(self, positions: np.ndarray, displacement: np.ndarray | None = None) -> np.ndarray:
        """Vertices (N, 3), or with `displacement` (base vertices, 3) their first-order motion.

        The motion is a translation and a change of size, so the ball stays a ball.
        """
        ball = positions[self.helper]
        centre = ball.mean(axis=0)
        arm = ball - centre
        radius = np.linalg.norm(arm, axis=-1).mean()
        if displacement is None:
            return centre + radius * self.directions
        shift = displacement[self.helper].mean(axis=0)
        growth = np.sum(arm * (displacement[self.helper] - shift)) / np.sum(arm**2)
        return shift + growth * radius * self.directions


def sphere() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit sphere with poles on +z and -z: vertices (N, 3), triangles, texture coordinates.

    The texture is the view along -z squeezed into a disc (azimuthal equidistant), so that the
    iris is a disc around the middle.
    """
    rings, sectors = _EYEBALL_RINGS, _EYEBALL_SECTORS
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(sectors) / sectors
    theta, phi = (grid.ravel() for grid in np.meshgrid(theta, phi, indexing="ij"))
    theta, phi = np.r_[0, theta, np.pi], np.r_[0, phi, 0]
    circle = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    vertices = np.concatenate([circle * np.sin(theta)[:, None], np.cos(theta)[:, None]], axis=-1)
    ring = 1 + np.arange(rings - 1)[:, None] * sectors + np.arange(sectors)
    after = np.roll(ring, -1, axis=1)
    last = len(vertices) - 1
    front = np.stack([np.zeros(sectors, int), ring[0], after[0]], axis=-1)
    back = np.stack([np.full(sectors, last), after[-1], ring[-1]], axis=-1)
    bands = np.stack([ring[:-1], ring[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([front, triangulate(bands), back])
    return vertices, triangles, 0.5 + circle * (theta / (2 * np.pi))[:, None]
