"""Stage 3, shape (paper, section 3.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..render.transport import linearize
from ..scene.arrays import device
from ..scene.gather import Corners
from ..scene.maps import Maps
from ..scene.mesh import surface, vertex_normals
from .estimate import Estimate
from .light_steps import LightSteps
from .losses import landmark_l2, shape_l2
from .problem import Problem
from .shading import LightSample, Shading
from .stage_run import StageRun, light_loss, trusted

mi = mitsuba()


class _Linearised:
    """Shading as stage 3 sees it between two refreshes: linear in the normals.

    diffuse and specular shading of the sample's pixels, on which the light is followed, are
    corrected for the normals' turn since its transport was tabulated.
    """

    def __init__(self, problem: Problem, shading: Shading, vertices: Any) -> None:
        self.problem, self.shading, self.traced = problem, shading, vertices
        dr.eval(shading.bits)  # of the mesh as it is, before it moves
        self.sample = LightSample(problem, shading)
        self.turned: tuple[Any, Any] = (0.0, 0.0)
        self.local: Any = None
        self.weight: Any = None
        self.corners: Any = None

    def refresh(self, vertices: Any, radiance: Any, maps: Maps) -> None:
        """Follow the mesh and the light; rays are traced anew once a vertex has moved enough."""
        problem = self.problem
        moved = float(dr.max(dr.norm(dr.detach(vertices) - self.traced)).numpy().item())
        problem.move(vertices)
        if moved > problem.settings.retrace_distance:
            self.traced = dr.detach(vertices)
            self.shading = Shading(problem, self.shading.cells)
            self.sample = LightSample(problem, self.shading)
        else:
            self.shading.points = problem.points()
        shading, sample = self.shading, self.sample
        self.corners = problem.mesh.hit_corners(problem.hits)
        known = radiance.numpy()
        shading.update(known, maps)
        self.local = linearize(shading.points, shading.quadrature, shading.bits, known)
        error = problem.settings.shading_error
        self.weight = trusted(problem, self.local.diffuse + shading.indirect[0], error)
        e, s = sample.transport.shade(radiance)
        self.turned = (sample.of(self.local.diffuse) - e, sample.of(self.local.specular) - s)
        dr.eval(self.turned)
        sample.hold(shading, *self.sampled(radiance))

    def sampled(self, radiance: Any) -> tuple[Any, Any]:
        """Direct E and S of the sample's pixels under the cells' `radiance`."""
        e, s = self.sample.transport.shade(radiance)
        return e + self.turned[0], s + self.turned[1]

    def shade(self, vertices: Any) -> tuple[Any, Any]:
        """E and S of all pixels, as functions of the vertices by their normals."""
        problem, mesh = self.problem, self.problem.mesh
        normals = vertex_normals(vertices, mesh.corners)
        _, normal, _ = surface(
            problem.camera, problem.hits, vertices, normals, mesh.triangles, self.corners
        )
        e, s = self.local.shade(normal, normal)
        return e + self.shading.indirect[0], s + self.shading.indirect[1]


def stage3(problem: Problem, estimate: Estimate, shading: Shading) -> tuple[Estimate, Shading]:
    """Shape: vertices through the large-steps preconditioner, textures in image space (3.3).

    Shading is linearised in the normals and refreshed every `refresh_interval` iterations. The
    light is followed as in stage 2, by one step in each iteration.
    """
    settings, stage = problem.settings, problem.settings.stage3
    begin = mi.Point3f(estimate.vertices)
    fitted = device(mi.Point3f, problem.observation.vertices)
    steps = mi.ad.LargeSteps(
        dr.ravel(begin), dr.ravel(problem.mesh.triangles), settings.shape_lambda
    )
    names = ("log_diffuse", "log_specular")
    light = LightSteps(settings, stage, estimate, shading.cells, steps=1)
    latent = mi.Float(steps.to_differential(dr.ravel(begin)))
    run = StageRun.of_maps(
        problem,
        "stage3",
        estimate,
        light,
        {"latent": latent},
        {"latent": stage.rate * settings.shape_rate},
        uniform=frozenset({"latent"}),
    )
    adam = run.adam
    landmarks = Landmarks(problem)
    linear = _Linearised(problem, shading, begin)
    for iteration in range(stage.iterations):
        vertices = dr.unravel(mi.Point3f, steps.from_differential(adam["latent"]))
        if iteration % settings.refresh_interval == 0:
            if iteration:
                e, _ = linear.sampled(light.known)
                run.normalize_light(e + linear.sample.of(linear.shading.indirect[0]))
            linear.refresh(vertices, light.known, problem.maps(run.result(estimate, *names)))
            specular = linear.local.specular + linear.shading.indirect[1]
            run.judge_gloss(specular, problem.weakest)
        e, s = linear.shade(vertices)
        if run.solver is not None:
            factors = linear.sample.changed(*linear.sampled(light.known))
            e, s = e * factors[0], s * factors[1]
        loss_of_light = light_loss(linear.sample, linear.shading, run, linear.sampled)
        now = (dr.detach(e), dr.detach(s))
        loss = run.loss_after_maps(e, s, linear.weight)
        held = stage.landmark * landmarks.loss(vertices)
        held += stage.shape * shape_l2(vertices, fitted, settings.shape_unit)
        run.step(loss + held)
        light.follow(loss_of_light)
        run.report(iteration, lambda now=now, held=held: run.map_loss(*now, linear.weight) + held)
        if run.converged:
            break

    vertices = dr.detach(dr.unravel(mi.Point3f, steps.from_differential(adam["latent"])))
    problem.move(vertices)
    return replace(run.result(estimate, *names), vertices=vertices), Shading(problem, shading.cells)


class Landmarks:
    """The weak keypoint loss of stage 3: points fixed on the mesh against the detected ones."""

    def __init__(self, problem: Problem) -> None:
        seen = problem.observation
        points = seen.landmark_points
        used = np.flatnonzero(points.triangle >= 0)
        self.corners = Corners(seen.triangles[points.triangle[used]], len(seen.vertices))
        self.share = device(mi.Vector3f, points.barycentric[used])
        self.detected = device(mi.Point2f, seen.landmarks[used])
        self.weight = device(mi.Float, np.full(len(used), 1 / max(len(used), 1), np.float32))
        camera = problem.camera
        self.width = camera.width
        self.pinhole = [dr.opaque(mi.Float, v) for v in (camera.focal, camera.cx, camera.cy)]

    def loss(self, vertices: Any) -> Any:
        """Mean squared distance in units of the crop's width; 0 without landmarks."""
        if not dr.width(self.weight):
            return mi.Float(0)
        focal, cx, cy = self.pinhole
        ((a, b, c),) = self.corners(vertices)
        point = a * self.share.x + b * self.share.y + c * self.share.z
        scale = focal / -point.z
        projected = mi.Point2f(cx + point.x * scale, cy - point.y * scale)
        return landmark_l2(projected, self.detected, self.weight, self.width)
