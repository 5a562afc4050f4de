"""Stage 2, low-frequency albedo (paper, section 3.2)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from .estimate import Estimate
from .light_steps import LightSteps
from .problem import Problem
from .shading import LightSample, Shading
from .stage_run import StageRun, light_loss, trusted

mi = mitsuba()


def stage2(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Low-frequency albedo: maps under strong smoothness, jointly with the light (section 3.2).

    The light follows the image loss of a sample of the pixels, in `light_steps` steps of each
    iteration. The maps see the shading of all, computed every `refresh_interval` iterations; how
    the light has changed it since is seen in the sample. (Maps that fit an old shading well, as
    those of the primal-dual solver do, would hold the light back; Adam's take it as it was.)
    """
    settings, stage = problem.settings, problem.settings.stage2
    dr.eval(shading.bits)  # the sample takes its own from those of all
    sample = LightSample(problem, shading)
    light = LightSteps(settings, stage, estimate, shading.cells, settings.light_steps)
    names = ("log_diffuse", "log_specular")
    run = StageRun.of_maps(problem, "stage2", estimate, light, {}, {})
    e: Any = None
    s: Any = None
    weight: Any = None
    for iteration in range(stage.iterations):
        if iteration % settings.refresh_interval == 0:
            if iteration:
                e, _ = sample.transport.shade(light.known)
                run.normalize_light(e + sample.of(shading.indirect[0]))
            known = light.known.numpy()
            shading.update(known, problem.maps(run.result(estimate, *names)))
            e, s = shading.shade(known)
            weight = trusted(problem, e, run.shading_error)
            run.judge_gloss(s, problem.weakest)
            dr.eval(e, s)
            sample.hold(shading, *sample.transport.shade(device(mi.Float, known)))
        now = (e, s)
        if run.solver is not None:
            factors = sample.changed(*sample.transport.shade(light.known))
            now = (e * factors[0], s * factors[1])
        loss_of_light = light_loss(sample, shading, run, sample.transport.shade)
        run.step(run.loss_after_maps(*now, weight))
        light.follow(loss_of_light)
        run.report(iteration, lambda now=now, weight=weight: run.map_loss(*now, weight))
        if run.converged:
            break
    return run.result(estimate, *names)
