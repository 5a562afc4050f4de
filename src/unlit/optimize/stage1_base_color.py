"""Stage 1, base colour and light (paper, section 3.1)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from .blend import Blend
from .estimate import Estimate
from .light_steps import LightSteps
from .losses import image_l1
from .problem import Problem
from .shading import LightSample, Shading
from .stage_run import StageRun, gloss_loss, rendered

mi = mitsuba()


def stage1(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Base colour and light: one diffuse and one specular albedo per region (section 3.1).

    With an albedo that cannot vary inside a region, shading has to be explained by the light. A
    sample of the pixels is enough for so few unknowns.
    """
    settings, stage = problem.settings, problem.settings.stage1
    sample = LightSample(problem, shading)
    light = LightSteps(settings, stage, estimate, shading.cells, steps=1)
    everywhere = Blend(problem.regions), problem.log_level
    sampled = Blend(problem.regions[sample.rows]), sample.of(problem.log_level)

    diffuse, specular = _starting_colors(problem, sample, light)
    run = StageRun(
        problem,
        "stage1",
        light,
        {"log_diffuse": diffuse, "log_specular": specular},
        {"log_diffuse": stage.rate, "log_specular": stage.rate},
    )
    adam = run.adam

    def blended(blend: Blend, log_level: Any) -> tuple[Any, Any]:
        base = blend(dr.exp(adam["log_diffuse"]), dr.exp(adam["log_specular"]))
        return dr.log(base[0]), dr.log(base[1]) + log_level

    def spread() -> Estimate:
        diffuse, specular = dr.detach(blended(*everywhere))
        return replace(run.result(estimate), log_diffuse=diffuse, log_specular=specular)

    level: Any = None
    for iteration in range(stage.iterations):
        refreshed = iteration % settings.refresh_interval == 0
        if refreshed:
            e, _ = sample.transport.shade(light.known)
            run.normalize_light(e + sample.of(shading.indirect[0]))
            _, s = sample.transport.shade(light.known)
            run.judge_gloss(s + sample.of(shading.indirect[1]), sample.weakest)
            shading.update(light.known.numpy(), problem.maps(spread()))
        e, s = sample.transport.shade(light.radiance)
        e, s = e + sample.of(shading.indirect[0]), s + sample.of(shading.indirect[1])
        log_diffuse, log_specular = blended(*sampled)
        image = rendered(log_diffuse, log_specular, e, s)
        loss = stage.image * image_l1(image, sample.target, sample.weight)
        # Gloss is judged in the gain of the last refresh: else it would grow cheaper with the gain.
        mean = dr.mean(dr.mean(e))
        level = dr.detach(mean) if refreshed else level
        gain = mean / level
        relative, s = log_specular - sampled[1] + dr.log(gain), s * dr.exp(sampled[1]) / gain
        loss += gloss_loss(settings, run.gloss, relative, s, sample.weight)
        run.step(loss)
        light.step()
        run.report(iteration, lambda loss=loss: loss)
        if run.converged:
            break
    e, _ = sample.transport.shade(light.known)
    run.normalize_light(e + sample.of(shading.indirect[0]))
    return spread()


def _starting_colors(problem: Problem, sample: LightSample, light: LightSteps) -> tuple[Any, Any]:
    """Log base colours that give each region its median colour under the starting light."""
    e, _ = sample.transport.shade(light.known)
    image = problem.rows(problem.observation.image)[sample.rows]
    level = float(np.median(e.numpy()))
    colours = []
    evident = sample.weight.numpy() > 0
    for share in problem.regions[sample.rows].T:
        inside = evident & (share > 0.5)
        colours.append(np.median(image[inside if inside.any() else evident], axis=0) / level)
    log_colours = np.log(np.maximum(np.array(colours), 1e-3)).astype(np.float32)
    specular = np.full(len(colours), np.log(problem.settings.nominal_specular), dtype=np.float32)
    return device(mi.Color3f, log_colours), device(mi.Float, specular)
