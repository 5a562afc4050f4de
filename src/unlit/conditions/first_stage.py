"""What a short stage 1 makes of a photo, for those who want to know before the stages begin.

All skin has one colour there, so the light explains what it can of the shading (paper, 3.1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..face.gain import AlbedoGain
from ..optimize.observation import Observation
from ..optimize.problem import Problem
from ..optimize.shading import Shading
from ..optimize.stage1_base_color import stage1
from ..optimize.stages import start
from ..progress.callbacks import silent
from ..scene.cells import grid_cells, refine
from ..scene.lobes import CellRadiance
from ..settings.settings import Settings


@dataclass(frozen=True)
class ShortStage1:
    """Images (H, W), 0 where the head and the mask do not both cover a pixel.

    diffuse_shading, specular_shading: E and S, mean of the channels; the best-lit skin has E = 1.
    render: (H, W, 3) linear sRGB, under white light. covered: bool, where head and mask both are.
    """

    diffuse_shading: np.ndarray
    specular_shading: np.ndarray
    render: np.ndarray
    covered: np.ndarray


def short_stage1(observation: Observation, settings: Settings) -> ShortStage1:
    """Stage 1 cut short. Raises ValueError when the mesh and the mask do not overlap."""
    stage = replace(settings.stage1, iterations=settings.first_stage_iterations)
    short = replace(settings, stage1=stage)
    problem = Problem(observation, short, AlbedoGain(), silent)
    cells = grid_cells(short.cell_rows, short.cell_columns)
    shading = Shading(problem, cells)
    with threadpool_limits(1, user_api="blas"):  # as in `optimize/solve.py`
        estimate = stage1(problem, start(problem), shading)
    light = estimate.light()
    shading = shading.under(refine(cells, light.rasterize(), limit=short.max_cells))
    radiance = CellRadiance(shading.cells).of(light)
    maps = problem.maps(estimate)
    shading.update(radiance, maps)
    e, s = (problem.image(part, "zero") for part in shading.shade(radiance))
    render = maps.diffuse_albedo * e + maps.specular_albedo[..., None] * s
    return ShortStage1(e.mean(axis=2), s.mean(axis=2), render, problem.inside)
