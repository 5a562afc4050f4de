"""Shading of the problem's pixels: visibility, indirect light, and the sample the light follows."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from scipy.spatial import KDTree

from ..machine.runtime import mitsuba
from ..render.interreflection import Interreflection, SpecularTransfer
from ..render.transport import Quadrature, ShadingPoints, Transport, shade, visibility
from ..render.visibility import bits_at
from ..scene.arrays import device
from ..scene.cells import SphereCells
from ..scene.maps import Maps
from .problem import Problem

mi = mitsuba()

#: Sampled pixels from which another takes its values; how far away, in widths of the crop, and how
#: differently turned, one is that counts half as near as the other.
_NEAREST = 4
_NEAR_PLACE, _NEAR_NORMAL = 0.05, 0.3
#: Around a sun whose shadow the image has no more, the head blocks no light; radians. Wide, since
#: the sun is found to some degrees and the lobes that stand for it have a width.
SUN_RADIUS = np.radians(20)


class Shading:
    """Everything that depends on the geometry and the quadrature: visibility, indirect light.

    cells: the D cells of the light. points: the P shading points. bits: mi.UInt32, visibility
    (render/visibility.py), of the mesh as it is when they are first asked for. indirect: E and S,
    mi.Color3f of width P, held constant between two calls of `update`. specular_transfer: what
    inter-reflection carries of the highlights; None has it computed for the next light.
    """

    def __init__(
        self, problem: Problem, cells: SphereCells, interreflection: Interreflection | None = None
    ) -> None:
        self.problem, self.cells = problem, cells
        self.quadrature = Quadrature(cells)
        self.points = self._traced = problem.points()
        self.interreflection = interreflection or self._interreflection()
        self.indirect_light = self.interreflection.under(self.quadrature)
        self.indirect: tuple[Any, Any] = (mi.Color3f(0), mi.Color3f(0))
        self.specular_transfer: SpecularTransfer | None = None

    @cached_property
    def bits(self) -> Any:
        """Traced when first asked for; stage 1 only needs those of its sample."""
        return self._trace(self._traced)

    def _trace(self, points: ShadingPoints) -> Any:
        scene, sun = self.problem.mesh.scene, self.problem.observation.sun
        if sun is None:
            return visibility(scene, points, self.quadrature)
        near = self.cells.direction @ sun > np.cos(SUN_RADIUS)
        return visibility(scene, points, self.quadrature, free=device(mi.UInt32, near))

    def bits_of(self, index: Any) -> Any:
        """Those of some pixels (mi.UInt32), traced only if those of all are not."""
        if "bits" in vars(self):
            return bits_at(self.bits, len(self._traced), index)
        return self._trace(self._traced.gather(index))

    def at(self, points: ShadingPoints) -> Shading:
        """The same geometry with the normals of `points`, for a look that leaves this as it is."""
        dr.eval(self.bits)  # traced once for both
        other = copy.copy(self)
        other.points = points
        return other

    def _interreflection(self) -> Interreflection:
        problem = self.problem
        roughness = problem.image(problem.roughness)
        bounces = problem.settings.bounces
        return Interreflection(problem.mesh, problem.camera, problem.hits, roughness, bounces)

    def under(self, cells: SphereCells) -> Shading:
        """The same geometry under another quadrature: form factors do not depend on it."""
        return Shading(self.problem, cells, self.interreflection)

    def update(self, radiance: np.ndarray, maps: Maps, gain: float | None = None) -> None:
        """Bring the indirect light up to date with the light's cell means (D,) and the maps.

        gain: of albedo, the problem's if None; 1 for maps that have it already.
        """
        maps = maps.with_gain(
            self.problem.albedo_gain(maps.diffuse_albedo) if gain is None else gain
        )
        change = self.problem.settings.gloss_change
        flux = self.quadrature.flux(radiance)
        if self.specular_transfer is None or self.specular_transfer.change(flux) > change:
            self.specular_transfer = self.indirect_light.specular_transfer(radiance)
        e, s = self.indirect_light.shade(radiance, maps, self.specular_transfer)
        self.indirect = (device(mi.Color3f, e), device(mi.Color3f, s))

    def shade(self, radiance: np.ndarray) -> tuple[Any, Any]:
        """Direct plus indirect E and S, mi.Color3f of width P, with the current normals."""
        e, s = shade(self.points, self.quadrature, self.bits, radiance)
        return mi.Color3f(e) + self.indirect[0], mi.Color3f(s) + self.indirect[1]


class LightSample:
    """An even sample of the pixels, enough for the light's few unknowns (stages 1 to 3).

    rows: (N,) uint32, which of the P pixels; target, weakest, weight: the problem's there, the
    weights summing to 1. Its transport is tabulated once, so that the light's gradient is two
    matrix products; the indirect light of `shading` is taken as it stands at each call. spread:
    carries its values to all P pixels.
    """

    def __init__(self, problem: Problem, shading: Shading) -> None:
        settings = problem.settings
        fitted = problem.fitted_rows
        count = min(settings.light_points, len(fitted))
        self.rows = fitted[np.unique(np.linspace(0, len(fitted) - 1, count).astype(np.int64))]
        self.index = device(mi.UInt32, self.rows)
        points, bits = shading.points.gather(self.index), shading.bits_of(self.index)
        self.transport = Transport(points, shading.quadrature, bits)
        self._all = (problem, shading.points)
        self.target, self.weakest = self.of(problem.target), self.of(problem.weakest)
        self.weight = self.of(problem.weight)
        self.weight /= dr.sum(self.weight)
        dr.eval(self.target, self.weakest, self.weight)

    @cached_property
    def spread(self) -> _Spread:
        """Made when first asked for: stage 1 and Adam have no use for it."""
        problem, points = self._all
        return _Spread(problem, self.rows, points.diffuse_normal.numpy().T)

    def of(self, values: Any) -> Any:
        """The sample of per-pixel values, of their own type."""
        return dr.gather(type(values), values, self.index)

    def hold(self, shading: Shading, e: Any, s: Any) -> None:
        """Remember the direct E and S of the sample when those of all pixels were computed."""
        self._indirect = [dr.mean(self.of(x)) for x in shading.indirect]
        self._held = [x + y for x, y in zip((e, s), self._indirect, strict=True)]
        dr.eval(self._indirect, self._held)

    def changed(self, e: Any, s: Any) -> tuple[Any, Any]:
        """Factors on E and S of all pixels since `hold`, mi.Float of width P, seen in the sample.

        e, s: the direct ones of the sample under the light as it is.
        """
        factors = []
        for now, indirect, held in zip((e, s), self._indirect, self._held, strict=True):
            least = 0.02 * dr.mean(held)
            factors.append(self.spread((dr.detach(now) + indirect + least) / (held + least)))
        dr.eval(factors)
        return factors[0], factors[1]


class _Spread:
    """Values of the sampled pixels carried to all P: the mean of the nearest, near ones most.

    Nearest by place and by normal. rows: (N,) the sample. normals: (P, 3).
    """

    def __init__(self, problem: Problem, rows: np.ndarray, normals: np.ndarray) -> None:
        width = problem.camera.width
        place = np.stack([problem.pixel % width, problem.pixel // width], axis=1) / width
        where = np.hstack([place / _NEAR_PLACE, normals / _NEAR_NORMAL])
        count = min(_NEAREST, len(rows))
        distance, near = KDTree(where[rows]).query(where, count)
        distance, near = np.reshape(distance, (-1, count)), np.reshape(near, (-1, count))
        share = 1 / (distance**2 + 1e-6)
        share /= share.sum(axis=1, keepdims=True)
        self.near = [device(mi.UInt32, n) for n in near.T]
        self.share = [device(mi.Float, s) for s in share.T]

    def __call__(self, values: Any) -> Any:
        """mi.Float of width P from one of width N."""
        pairs = zip(self.share, self.near, strict=True)
        return sum(share * dr.gather(mi.Float, values, near) for share, near in pairs)
