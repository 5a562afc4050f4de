"""Where the sun stands, and whether there is one: among many directions, which explains the skin.

Of each direction `SkinSample` says how well it explains light and shade; around the best it is
looked for again, more closely. Whether there is a sun is told from how much more an even light
leaves unexplained, dark outliers allowed, and from the colours: the rest of the light is bluer than
the sun, by as much as the sky is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..machine.runtime import mitsuba
from ..optimize.problem import Problem
from ..render.interreflection import sphere_directions
from ..render.visibility import trace, unpacked
from ..scene.arrays import device
from ..settings.sun import SunSearch
from .sun_model import SkinSample, first_order, light_of_rest

mi = mitsuba()

#: Side of the crop that the settings' lengths are for, pixels.
SIZE = 256
#: Cosines to the camera's axis and to up below which a light is behind or under the face.
_LEAST_TOWARDS, _LEAST_UP = -0.35, -0.5
#: Directions that are searched more closely, and the rings of how many around them, radians.
_BEST, _RINGS, _AROUND = 4, (0.2, 0.1, 0.05), 6
#: Rounds of labels and terms: in the search, and for what is kept.
_ROUNDS, _LAST_ROUNDS = 6, 10
#: Half of what the light is taken to subtend, radians: the mesh's shadow is not known to a hair.
_SEARCH_WIDTH, _WIDTH = 0.08, 0.04
_RAYS = 4
#: Below the horizon of every normal.
_ALL = -1.1


@dataclass(frozen=True)
class SunFit:
    """What `SkinSample` has fitted: linear light times the skin's mean albedo.

    direction: (3,) unit, world frame. color: (3,) s. even: (4, 3) rows b, c; level: (3,) their mean
    on the skin. evidence: how much more an even light alone leaves, mean cost.
    """

    direction: np.ndarray
    color: np.ndarray
    even: np.ndarray
    level: np.ndarray
    evidence: float

    def parts(self, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Light of the sun without any shadow, and of the rest, (P, 3) each, at normals (P, 3)."""
        facing = np.maximum(normal @ self.direction, 0)[:, None]
        return facing * self.color, light_of_rest(first_order(normal), self.even)


class Surface:
    """The problem's pixels: position and normals, (P, 3) float32, and what the mesh hides."""

    def __init__(self, problem: Problem) -> None:
        points = problem.points()
        self.scene = problem.mesh.scene
        self.position, self.normal, self.geometric = (
            x.numpy().T for x in (points.position, points.diffuse_normal, points.geometric)
        )

    def open(self, directions: np.ndarray, width: float, rows: Any = slice(None)) -> np.ndarray:
        """(K, P) float32: share of a light of half-angle `width` that the mesh lets through.

        directions: (K, 3). rows: which pixels.
        """
        rays = np.concatenate([_ring(axis, width / np.sqrt(2), _RAYS) for axis in directions])
        where = (self.position[rows], self.normal[rows], self.geometric[rows])
        kinds = (mi.Point3f, mi.Vector3f, mi.Vector3f)
        position, normal, geometric = (device(k, x) for k, x in zip(kinds, where, strict=True))
        towards = device(mi.Vector3f, rays)
        bits = trace(self.scene, position, normal, geometric, towards, _ALL)
        seen = unpacked(bits, len(where[0]), len(rays))
        return seen.reshape(len(directions), _RAYS, -1).mean(axis=1, dtype=np.float32)


def find_sun(problem: Problem, surface: Surface, settings: SunSearch) -> SunFit | None:
    """The likeliest sun of the photo; None where too little plain skin is seen."""
    sample = SkinSample.of(problem, surface.normal, settings)
    if sample is None:
        return None
    flat = _directions(settings.directions)
    open_ = surface.open(flat, _SEARCH_WIDTH, sample.rows)
    cost, terms = sample.best(flat, open_, _ROUNDS)
    around = flat[np.argsort(cost, kind="stable")[:_BEST]]
    for radius in _RINGS:
        near = np.stack([np.vstack([axis, _ring(axis, radius, _AROUND)]) for axis in around])
        flat = near.reshape(-1, 3)
        open_ = surface.open(flat, _WIDTH, sample.rows)
        cost, terms = sample.best(flat, open_, _LAST_ROUNDS)
        each = cost.reshape(len(around), -1).argmin(axis=1)
        around = near[np.arange(len(around)), each]
    best = int(cost.argmin())
    color, even = np.maximum(terms[best, 0], 0), terms[best, 1:]
    level = light_of_rest(first_order(sample.normal), even).mean(axis=0)
    evidence = sample.cost_without_sun()
    evidence -= sample.cost_with_sun(flat[best], open_[best], terms[best])
    evidence += settings.sky * as_sky(color, level, settings)
    return SunFit(flat[best], color, even, level, evidence)


def as_sky(sun: np.ndarray, rest: np.ndarray, settings: SunSearch) -> bool:
    """Whether two colours of light (3,) differ as those of sun and sky do."""
    if min(sun.min(), rest.min()) <= 0:
        return False
    (low, high), (least, most) = settings.stronger, settings.bluer
    bluer = rest[2] / rest[0] * sun[0] / sun[2]
    return bool(low < sun.mean() / rest.mean() < high and least < bluer < most)


def _directions(count: int) -> np.ndarray:
    """(K, 3) of `count` evenly spread ones, where a light can reach a face."""
    everywhere = sphere_directions(count)[:, [0, 2, 1]].astype(np.float64)
    return everywhere[(everywhere[:, 2] > _LEAST_TOWARDS) & (everywhere[:, 1] > _LEAST_UP)]


def _ring(axis: np.ndarray, radius: float, count: int) -> np.ndarray:
    """(count, 3) unit vectors at `radius`, radians, around the unit vector `axis`."""
    aside = np.cross(axis, (0.0, 1.0, 0.0) if abs(axis[1]) < 0.9 else (1.0, 0.0, 0.0))
    aside /= np.linalg.norm(aside)
    other = np.cross(axis, aside)
    angle = 2 * np.pi * np.arange(count)[:, None] / count
    across = np.cos(angle) * aside + np.sin(angle) * other
    return np.cos(radius) * axis + np.sin(radius) * across
