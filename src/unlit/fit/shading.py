"""Fit the head model to the photo's shading, before the five stages.

Landmarks leave the head's turn some degrees off and say little about its shape. Shading knows
more: Gauss-Newton over pose, identity, expression, the light (one non-negative radiance per cell),
a coarse grid of log albedo, the albedo's dependence on colour, and one specular scale, on some
thousand pixels of plain skin, with the transport renderer's own shading and derivatives:

    encode(rho E(n) + rho_s S(n)) = encode(photo),      E, S linear in the light

Landmarks and the model's prior take part as in landmarks.py. Neighbouring pixels err together, so
all of them count as few independent measurements. Derivatives hold the shadows where they are, so
the descent starts from several turns of the head and the lowest cost decides. Where the light is
so even that shading does not improve on the landmarks' mesh, that mesh is kept.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np
from scipy import ndimage

from ..machine.runtime import mitsuba
from ..perception.measures import face_area
from ..perception.regions import Regions
from ..render.transport import Quadrature, ShadingPoints, linearize, transport_rows, visibility
from ..scene.arrays import device
from ..scene.cells import grid_cells
from ..scene.mesh import CameraHits, Mesh, surface, surface_weights
from ..settings.fit import ShadingFit
from ..settings.regions import RoughnessByRegion
from .landmarks import HeadFit, LandmarkProblem, bounded_solve
from .shape_jacobian import SeenPixels, ShapeJacobian
from .state import STATED_RESOLUTION, State

mi = mitsuba()

_GAMMA = 2.2
# Weights of red, green and blue: the light has no colour, so one channel holds all shading.
_GREY = np.array([0.35, 0.45, 0.2], dtype=np.float32)
_ALBEDO = 0.4
_SPECULAR = 0.7
_BRIGHTEST = 0.97


@dataclass(frozen=True)
class _Appearance:
    """Light (D + 1,): radiance of each cell, and of the face itself where it blocks a cell.

    albedo: (A,) coefficients of log albedo; gloss: log of the specular scale.
    """

    light: np.ndarray
    albedo: np.ndarray
    gloss: float


@dataclass(frozen=True)
class _Sample:
    """Pixels that show the mesh, the same for the renderer, and the mesh for its shadow rays."""

    seen: SeenPixels
    points: ShadingPoints
    scene: Any


class ShadingProblem:
    """The fit of one photo: what every step of the descent reads of it, and the steps.

    problem: of the landmarks. image: (S, S, 3) linear sRGB, seen by the problem's camera.
    """

    def __init__(
        self,
        problem: LandmarkProblem,
        image: np.ndarray,
        regions: Regions,
        settings: ShadingFit,
    ) -> None:
        self.problem, self.settings = problem, settings
        self.model, self.camera = problem.model, problem.camera
        self.pixel = problem.pixel
        blur = settings.blur * self.pixel
        smooth: Any = ndimage.gaussian_filter(np.maximum(image, 1e-4), (blur, blur, 0))
        self.grey = smooth @ _GREY
        log = np.log(smooth)
        self.chroma = log[..., :2] - log[..., 1:]
        reach = 2 * max(1, round(settings.margin * self.pixel)) + 1
        bare = regions.skin + regions.lips > 0.5
        bare &= smooth.max(axis=2) < _BRIGHTEST
        # Ears and neck are not held by landmarks: their shading would bend the light.
        bare &= face_area(problem.landmarks[:, :2], len(image))
        # A square's minimum, which unlike `binary_erosion` is taken axis by axis.
        self.bare: Any = ndimage.minimum_filter(bare, reach, mode="constant")
        self.lips = regions.lips
        self.grid = int(np.ceil(STATED_RESOLUTION / settings.spacing))
        self.directions = self.camera.directions().reshape(-1, 3)
        self.jacobian = ShapeJacobian(self.model, self.camera)
        self.mesh: Mesh | None = None

    def solve(self, fit: HeadFit, mouth_closed: bool) -> HeadFit:
        """`fit`, to the landmarks, improved by shading, or itself where shading says too little.

        mouth_closed: as for `LandmarkProblem.solve`.
        """
        settings, state = self.settings, fit.state
        identity, expression = (x.astype(np.float64) for x in (state.identity, state.expression))
        state = replace(state, identity=identity, expression=expression)
        start = self.begin(state)
        if start is None or self.direction(start[1]) < settings.directed:
            return fit
        lowest = self.cost(state, start[2])
        best = None
        turns = settings.turns if self.problem.lit_share < settings.least_lit else ()
        # One at a time: the cells of the light are those of the start that was begun last.
        others = (self.begin(self.problem.turned(state, turn)) for turn in turns)
        for begun in itertools.chain([start], others):
            end = None if begun is None else self.descend(*begun[:2], lowest)
            if end is not None and end[1] < lowest:
                best, lowest = end
        return fit if best is None else self.problem.fit(best, mouth_closed)

    def begin(self, state: State) -> tuple[_Sample, _Appearance, float] | None:
        """The sample of `state`, its light on cells as fine as needed, and the photometric cost."""
        self.cells = grid_cells(self.settings.cells, 2 * self.settings.cells)
        sample = self.sample(state)
        return None if sample is None else (sample, *self.solve_light(sample, None))

    def descend(
        self, sample: _Sample, appearance: _Appearance, highest: float
    ) -> tuple[State, float] | None:
        """Where the steps from a start lead, and the cost there; None where no skin is seen.

        Shadows are held where they are while a step is made, so that steps may be too long. Where
        they end above the cost `highest`, the best state on the way is taken.
        """
        way = []
        for step in range(self.settings.joint_steps):
            state, moved, photometric = self.joint_step(sample, appearance)
            if step:
                way.append((sample.seen.state, photometric))
            if (seen := self.sample(state)) is None:
                return None
            sample, appearance = seen, moved
        state = sample.seen.state
        end = (state, self.cost(state, self.solve_light(sample, appearance)[1]))
        if end[1] < highest:
            return end
        costs = [(state, self.cost(state, photometric)) for state, photometric in way]
        return min([end, *costs], key=lambda at: at[1])

    def cost(self, state: State, photometric: float) -> float:
        """All that is minimised: `photometric`, the landmarks' and outline's cost, the prior's."""
        precision, current = self.prior(state)[:2]
        of_landmarks = self.problem.equations(state)[2]
        return photometric + of_landmarks + 0.5 * float(precision @ current**2)

    def prior(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """As the landmarks' problem has it, but the identity is held more tightly."""
        precision, current, low, high = self.problem.prior(state)
        precision[6 : 6 + len(state.identity)] *= self.settings.identity_weight
        return precision, current, low, high

    def sample(self, state: State) -> _Sample | None:
        """The mesh at `state` and an even sample of the plain skin it shows; None without any."""
        local = self.model.vertices(state.identity, state.expression)
        world = state.placed(local).astype(np.float32)
        if self.mesh is None:
            self.mesh = Mesh(world, self.model.triangles)
        else:
            self.mesh.set_vertices(device(mi.Point3f, world))
        mesh, camera = self.mesh, self.camera
        hits = mesh.camera_hits(camera)
        pixel, triangle = (a.numpy().astype(np.int64) for a in (hits.pixel, hits.triangle))
        normal = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)[1].numpy().T
        normals = np.zeros((camera.height * camera.width, 3), dtype=np.float32)
        normals[pixel] = normal
        cosine = -np.sum(normal * self.directions[pixel], axis=1)
        skin = (self.model.vertex_region <= 1)[self.model.triangles[triangle]].all(axis=1)
        seen = np.flatnonzero(self.bare.ravel()[pixel] & skin & (cosine > self.settings.facing))
        if len(seen) < self.settings.independent:
            return None
        count = min(self.settings.samples, len(seen))
        seen = seen[np.linspace(0, len(seen) - 1, count).astype(np.int64)]
        pixel, triangle = pixel[seen], triangle[seen]
        hits = CameraHits(device(mi.UInt32, pixel), device(mi.UInt32, triangle))
        position, n, geometric = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
        roughness = dr.full(mi.Float, RoughnessByRegion().skin, count)
        dr.eval(position, n, geometric)
        weights = surface_weights(camera, hits, mesh.vertices, mesh.triangles)[1]
        weights, place = weights.numpy().T, position.numpy().T
        normals = normals.reshape(camera.height, camera.width, 3)
        seen = SeenPixels(state, local, pixel, triangle, weights, place, normals)
        points = ShadingPoints(position, n, n, geometric, roughness)
        return _Sample(seen, points, mesh.scene)

    def albedo_columns(self, pixel: np.ndarray) -> np.ndarray:
        """Log albedo's derivatives (N, A): bilinear weights of the grid, chromaticity, lips."""
        xy = np.stack([pixel % self.camera.width, pixel // self.camera.width], axis=1) + 0.5
        place = np.clip(xy / (self.pixel * self.settings.spacing) - 0.5, 0, self.grid - 1.001)
        low = place.astype(np.int64)
        part = place - low
        columns = np.zeros((len(pixel), self.grid**2))
        row = np.arange(len(pixel))
        for x in (0, 1):
            for y in (0, 1):
                share = np.abs(1 - x - part[:, 0]) * np.abs(1 - y - part[:, 1])
                columns[row, (low[:, 1] + y) * self.grid + low[:, 0] + x] = share
        chroma = self.chroma.reshape(-1, 2)
        chroma = chroma[pixel] - np.median(chroma[self.bare.ravel()], axis=0)
        return np.concatenate([columns, chroma, self.lips.ravel()[pixel, None]], axis=1)

    def solve_light(
        self, sample: _Sample, appearance: _Appearance | None
    ) -> tuple[_Appearance, float]:
        """Light, albedo and gloss solved for on the mesh of `sample`; the photometric cost."""
        steps = self.settings.light_steps if appearance is None else 2
        system = None
        for step in range(steps):
            if system is None:
                system = _System(self, sample)
            if appearance is None:
                appearance = system.start()
            matrix, gradient = system.equations(appearance, None)[:2]
            appearance = system.solve(appearance, matrix, gradient)[0]
            if step < steps - 2 and (finer := self.finer(appearance)) is not appearance:
                appearance, system = finer, None
        assert system is not None and appearance is not None
        return appearance, system.equations(appearance, None)[2]

    def direction(self, appearance: _Appearance) -> float:
        """Length of the light's mean direction: 0 for an even light, 1 for a single lamp."""
        mean = appearance.light[:-1] @ self.cells.moment
        return float(
            np.linalg.norm(mean) / max(appearance.light[:-1] @ self.cells.solid_angle, 1e-12)
        )

    def finer(self, appearance: _Appearance) -> _Appearance:
        """The same light on cells cut in four where they hold much of it."""
        light = appearance.light[:-1]
        flux = light * self.cells.solid_angle
        height = np.degrees(np.diff(self.cells.theta, axis=1)[:, 0])
        which = (flux > self.settings.split * flux.sum()) & (height > self.settings.finest)
        if not which.any():
            return appearance
        self.cells = self.cells.split(which)
        light = np.concatenate([light[~which], np.tile(light[which], 4), appearance.light[-1:]])
        return replace(appearance, light=light)

    def joint_step(
        self, sample: _Sample, appearance: _Appearance
    ) -> tuple[State, _Appearance, float]:
        """One damped Gauss-Newton step of everything; the photometric cost before it."""
        problem, state = self.problem, sample.seen.state
        system = _System(self, sample)
        matrix, gradient, before = system.equations(appearance, self.jacobian)
        first = len(matrix) - 6 - len(problem.basis)
        of_landmarks = problem.equations(state)
        precision, current, low, high = self.prior(state)
        matrix[first:, first:] += of_landmarks[0] + np.diag(precision)
        gradient[first:] += of_landmarks[1] + precision * current
        appearance, move = system.solve(appearance, matrix, gradient, low, high)
        return state.moved(move), appearance, before


class _System:
    """The normal equations of one sample: light, albedo, gloss, then pose and shape."""

    def __init__(self, owner: ShadingProblem, sample: _Sample) -> None:
        self.settings, self.sample, self.cells = owner.settings, sample, owner.cells
        quadrature = Quadrature(owner.cells)
        bits = visibility(sample.scene, sample.points, quadrature)
        self.quadrature = (quadrature, bits)
        diffuse, specular = transport_rows(sample.points, quadrature, bits)
        # Where the face hides the light it sends its own: one more source, the same everywhere.
        hidden = np.maximum(1 - diffuse.sum(axis=1, keepdims=True), 0)
        self.diffuse = np.concatenate([diffuse, hidden], axis=1)
        self.specular = np.concatenate([specular, np.zeros_like(hidden)], axis=1)
        self.grey = owner.grey.ravel()[sample.seen.pixel]
        self.columns = owner.albedo_columns(sample.seen.pixel)

    def start(self) -> _Appearance:
        """An even light and albedo that give the median value."""
        level = np.median(self.grey) / np.median(self.diffuse.sum(axis=1)) / _ALBEDO
        light = np.append(np.full(len(self.cells), level), _ALBEDO * level)
        return _Appearance(light, np.zeros(self.columns.shape[1]), 0.0)

    def equations(
        self, appearance: _Appearance, shape: ShapeJacobian | None
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Matrix, gradient and cost, prior included; with pose and shape if `shape` is given."""
        settings, sample = self.settings, self.sample
        rho = _ALBEDO * np.exp(self.columns @ appearance.albedo)
        rho_s = _SPECULAR * np.exp(appearance.gloss)
        e, s = self.diffuse @ appearance.light, self.specular @ appearance.light
        value = np.maximum(rho * e + rho_s * s, 1e-5)
        encoded = value ** (1 / _GAMMA)
        slope = encoded / (_GAMMA * value)
        error = encoded - np.maximum(self.grey, 1e-5) ** (1 / _GAMMA)
        blocks = [
            slope[:, None] * (rho[:, None] * self.diffuse + rho_s * self.specular),
            (slope * rho * e)[:, None] * self.columns,
            (slope * rho_s * s)[:, None],
        ]
        if shape is not None:
            about = linearize(
                sample.points, *self.quadrature, appearance.light[:-1].astype(np.float32)
            )
            gradient = rho[:, None] * about.diffuse_gradient.numpy().T
            gradient += rho_s * about.specular_gradient.numpy().T
            blocks.append(slope[:, None] * shape.rows(sample.seen, gradient))
        jacobian = np.concatenate(blocks, axis=1)
        size = np.abs(error)
        each = settings.independent / len(error) / settings.deviation**2
        weight = each * np.minimum(1, settings.huber / np.maximum(size, 1e-9))
        matrix = (jacobian * weight[:, None]).T @ jacobian
        gradient = jacobian.T @ (weight * error)
        precision, away = self._prior(appearance)
        diagonal = np.arange(len(precision))
        matrix[diagonal, diagonal] += precision
        gradient[: len(precision)] += precision * away
        beyond = settings.huber * (size - 0.5 * settings.huber)
        cost = each * np.where(size < settings.huber, 0.5 * error**2, beyond).sum()
        cost += 0.5 * np.sum(precision * away**2)
        return matrix, gradient, float(cost)

    def _prior(self, appearance: _Appearance) -> tuple[np.ndarray, np.ndarray]:
        """Precision of light, albedo and gloss, and their distance from what is likeliest."""
        settings = self.settings
        area = self.cells.solid_angle / self.cells.solid_angle.mean()
        mean = np.average(appearance.light[:-1], weights=area)
        likely = np.append(np.full(len(area), mean), _ALBEDO * mean)
        light = np.append(settings.evenness * area, _ALBEDO**-2) / mean**2
        albedo = np.full(len(appearance.albedo), settings.albedo_deviation**-2)
        albedo[-3:] = (settings.colour_deviation**-2, settings.colour_deviation**-2, 1.0)
        precision = np.concatenate([light, albedo, [4.0]])
        return precision, np.concatenate(
            [appearance.light - likely, appearance.albedo, [appearance.gloss]]
        )

    def solve(
        self,
        appearance: _Appearance,
        matrix: np.ndarray,
        gradient: np.ndarray,
        low: np.ndarray | None = None,
        high: np.ndarray | None = None,
    ) -> tuple[_Appearance, np.ndarray]:
        """The new appearance and the rest of the step, within the bounds (of the rest)."""
        count, own = len(appearance.light), len(appearance.light) + len(appearance.albedo) + 1
        lowest, highest = np.full(len(matrix), -np.inf), np.full(len(matrix), np.inf)
        lowest[:count] = -appearance.light
        if low is not None and high is not None:
            lowest[own:], highest[own:] = low, high
        damped = matrix + self.settings.damping * np.diag(np.diag(matrix))
        move = bounded_solve(damped, -gradient, lowest, highest)
        appearance = _Appearance(
            np.maximum(appearance.light + move[:count], 0),
            appearance.albedo + move[count : own - 1],
            float(appearance.gloss + move[own - 1]),
        )
        return appearance, move[own:]
