"""Stage 2, low-frequency albedo (paper, section 3.2)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..scene.lobes import CellRadiance
from .estimate import Estimate
from .problem import Problem
from .shading import LightSample, Shading
from .stage_run import (
    StageRun,
    light_loss,
    light_parameters,
    light_rates,
    map_loss,
    radiance_of,
    trusted,
)


def stage2(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Low-frequency albedo: maps under strong smoothness, jointly with the light (section 3.2).

    The light follows the image loss of a sample of the pixels at every iteration; the maps see
    its shading on all pixels, brought up to date every `refresh_interval` iterations.
    """
    settings, stage = problem.settings, problem.settings.stage2
    sample = LightSample(problem, shading)
    cells = CellRadiance(shading.cells)
    names = ("log_diffuse", "log_specular", *light_parameters(estimate))
    run = StageRun(
        problem,
        "stage2",
        {name: getattr(estimate, name) for name in names},
        {**light_rates(stage), "log_diffuse": stage.rate, "log_specular": stage.rate},
    )
    adam = run.adam
    e: Any = None
    s: Any = None
    weight: Any = None
    for iteration in range(stage.iterations):
        if iteration % settings.refresh_interval == 0:
            if iteration:
                e, _ = sample.transport.shade(dr.detach(radiance_of(cells, adam)))
                run.normalize_light(e + sample.of(shading.indirect[0]))
            known = dr.detach(radiance_of(cells, adam)).numpy()
            shading.update(known, problem.maps(run.result(estimate, *names)))
            e, s = shading.shade(known)
            weight = trusted(problem, e)
            dr.eval(e, s)
        radiance = radiance_of(cells, adam)
        loss = map_loss(problem, stage, adam, e, s, weight)
        of_light = light_loss(sample, shading, adam, *sample.transport.shade(radiance))
        run.step(iteration, loss, stage.image * of_light)
    return run.result(estimate, *names)
