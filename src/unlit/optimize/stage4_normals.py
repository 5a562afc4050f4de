"""Stages 4 and 5, normals and high-frequency albedo (paper, sections 3.4 and 3.5)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..render.transport import linearize
from ..scene.lobes import CellRadiance
from ..scene.maps import DIFFUSE_BLUR
from ..settings.settings import Settings
from ..settings.table1 import Stage
from .blur import Blur
from .estimate import Estimate
from .losses import normal_l2
from .problem import Problem
from .shading import Shading
from .stage_run import StageRun, trusted


def _normals_and_albedo(
    problem: Problem, estimate: Estimate, shading: Shading, name: str
) -> Estimate:
    """Stages 4 and 5: albedo maps and normal perturbation under a fixed light and mesh."""
    settings: Settings = problem.settings
    stage: Stage = getattr(settings, name)
    names = ("log_diffuse", "log_specular", "perturbation")
    by_adam = {"perturbation": estimate.perturbation} if settings.solver == "adam" else {}
    rates = dict.fromkeys(by_adam, stage.rate)
    run = StageRun.of_maps(problem, name, estimate, None, by_adam, rates)
    if run.solver is not None:
        run.solver.follow_normals(estimate.perturbation)
    blur = Blur(problem.pixel, problem.camera.width, problem.camera.height, DIFFUSE_BLUR)
    mesh_normal = problem.points().specular_normal
    radiance = CellRadiance(shading.cells).of(estimate.light())
    local: Any = None
    weight: Any = None
    for iteration in range(stage.iterations):
        perturbation = run["perturbation"]
        specular_normal = dr.normalize(mesh_normal + perturbation)
        diffuse_normal = dr.normalize(mesh_normal + blur(perturbation))
        if iteration % settings.refresh_interval == 0:
            turned = (dr.detach(diffuse_normal), dr.detach(specular_normal))
            dr.eval(*turned)
            shading.points = problem.points(*turned)
            local = linearize(shading.points, shading.quadrature, shading.bits, radiance)
            shading.update(radiance, problem.maps(run.result(estimate, *names)))
            weight = trusted(problem, local.diffuse + shading.indirect[0], run.shading_error)
            run.judge_gloss(local.specular + shading.indirect[1], problem.weakest)
        e, s = local.shade(diffuse_normal, specular_normal)
        e, s = e + shading.indirect[0], s + shading.indirect[1]
        now = (dr.detach(e), dr.detach(s), weight)
        loss = run.loss_after_maps(e, s, weight)
        cost = stage.normal * settings.normal_scale
        held = cost * normal_l2(perturbation)
        if run.solver is None:
            run.step(loss + held)
        else:
            run.solver.turn_normals(loss, cost)
        run.report(iteration, lambda now=now, held=held: run.map_loss(*now) + held)
        if run.converged:
            break
    return run.result(estimate, *names)


def stage4(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Normals: a perturbation per texel for the specular normal, blurred for the diffuse (3.4)."""
    return _normals_and_albedo(problem, estimate, shading, "stage4")


def stage5(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """High-frequency albedo: the same unknowns under weaker smoothness (section 3.5)."""
    return _normals_and_albedo(problem, estimate, shading, "stage5")
