"""The five stages of the guided optimisation in order (paper, section 3).

Every stage takes and returns an `Estimate`. What a stage minimises is written out in its module
in the order of the paper's equations; the weights and rates are the columns of Table 1
(settings/table1.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from ..scene.cells import SphereCells, grid_cells, refine
from ..scene.light import grid_lobes
from .estimate import Estimate
from .fine_detail import with_fine_detail
from .problem import Problem
from .shading import Shading
from .stage1_base_color import stage1
from .stage2_albedo import stage2
from .stage3_shape import stage3
from .stage4_normals import stage4, stage5
from .stage_run import with_unit_light

mi = mitsuba()


def start(problem: Problem) -> Estimate:
    """The estimate before stage 1: a near-uniform light and white maps that stage 1 will set."""
    settings = problem.settings
    lobes = grid_lobes(settings.start_sharpness, 1.0)
    count = len(problem)
    return Estimate(
        device(mi.Point3f, problem.observation.vertices),
        dr.zeros(mi.Color3f, count),
        dr.zeros(mi.Float, count),
        dr.zeros(mi.Vector3f, count),
        device(mi.Vector3f, lobes.axis),
        device(mi.Float, np.log(lobes.sharpness)),
        device(mi.Float, np.log(lobes.amplitude)),
        dr.zeros(mi.Color3f, count),
        dr.zeros(mi.Vector4f, count),
        dr.zeros(mi.Vector4f, count),
    )


def _with_one_gloss(problem: Problem, estimate: Estimate) -> Estimate:
    """Specular albedo at the median of its regions, where stage 2 is to begin.

    So strong is that stage's smoothness that the map ends up with one level, but for what
    the settings have between regions of the skin.
    """
    level = float(np.median((estimate.log_specular - problem.log_level).numpy()))
    return replace(estimate, log_specular=problem.log_level + dr.opaque(mi.Float, level))


@dataclass(frozen=True)
class Begin:
    """What `run_stages` begins with: the first `done` stages have left this behind.

    cells: of the light; without them the regular grid is refined for the estimate's. normals:
    diffuse and specular (mi.Vector3f, P), as the shading last had them; without them the mesh's.
    losses: of the stages that are done, as in Metrics.
    """

    done: int
    estimate: Estimate
    cells: SphereCells | None = None
    normals: tuple[Any, Any] = (None, None)
    losses: dict[str, list[tuple[int, float]]] = field(default_factory=dict)


def run_stages(
    problem: Problem,
    after: Callable[[str, Estimate, Shading], None],
    begin: Begin | None = None,
) -> tuple[Estimate, Shading]:
    """The schedule, or what `begin` leaves of it; the problem's mesh is where `begin` has it.

    `after` is called with (stage name, estimate, shading) at the end of each stage. What one
    stage hands to the next goes through NumPy arrays, also when none of it is saved, and nothing is
    kept of a light that has been left: so a run that is resumed from a file cannot differ from one
    that was never interrupted.
    """
    settings = problem.settings
    begin = begin or Begin(0, start(problem))
    done, estimate = begin.done, begin.estimate
    regular = grid_cells(settings.cell_rows, settings.cell_columns)

    def ended(name: str, estimate: Estimate, shading: Shading) -> Estimate:
        estimate = Estimate.of(estimate.arrays())
        after(name, estimate, shading)  # a preview may use what the stage knew of highlights
        shading.specular_transfer = None
        return estimate

    def refined(estimate: Estimate) -> SphereCells:
        return refine(regular, estimate.light().rasterize(), limit=settings.max_cells)

    shading = Shading(problem, begin.cells or (refined(estimate) if done else regular))
    if done < 1:
        estimate = stage1(problem, estimate, shading)
        if settings.solver != "adam":
            estimate = _with_one_gloss(problem, estimate)
        shading = shading.under(refined(estimate))
        estimate = ended("stage1", estimate, shading)
    if done < 2:
        estimate = with_unit_light(problem, stage2(problem, estimate, shading), shading)
        estimate = ended("stage2", estimate, shading)
    if done < 3:
        estimate, shading = stage3(problem, estimate, shading)
        estimate = ended("stage3", with_unit_light(problem, estimate, shading), shading)
    else:
        shading.points = problem.points(*begin.normals)
    if done < 4:
        estimate = ended("stage4", stage4(problem, estimate, shading), shading)
    if done < 5:
        estimate = with_unit_light(problem, stage5(problem, estimate, shading), shading)
        estimate = with_fine_detail(problem, estimate, shading)
        estimate = ended("stage5", estimate, shading)
    return estimate, shading
