"""Go on from a saved result: the later stages again, started from its maps, light and mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import SettingsError
from ..face.reconstruction import Reconstruction
from ..optimize.estimate import Estimate
from ..optimize.problem import Problem
from ..optimize.relief import before_relief
from ..optimize.run_record import RunRecord
from ..optimize.stages import Begin
from ..progress.callbacks import StageProgress, silent
from ..settings.settings import Settings, as_dict, flat
from ..settings.table1 import TABLE_1
from .chain import Preview, Steps, run_chain

#: Darker maps, and lobes, are raised to this, as their logarithms are what is optimised.
_LEAST = 1e-3
_LEAST_LIGHT = 1e-8
#: Settings of the steps before the stages, which are not done again. What `cast_shadow` says of
#: the result's shading goes with them.
_KEPT = (
    *("resolution", "head_model", "landmark_fit", "outline_fit", "shading_fit", "light_color"),
    *("light_color_estimate", "cast_shadow", "sun", "sun_shadow", "tint", "first_stage_iterations"),
)


def check_resumable(result: Reconstruction, stage: int, settings: Settings) -> None:
    """Raise SettingsError for a stage or settings with which `result` cannot be continued."""
    if not 1 <= stage <= len(TABLE_1):
        raise SettingsError(f"stage {stage}: choose 1 to {len(TABLE_1)}")
    saved = flat(as_dict(result.settings))
    for name, wanted in flat(as_dict(settings)).items():
        if name.partition(".")[0] in _KEPT and wanted != saved[name]:
            raise SettingsError(
                f"{name}={wanted}: the saved result keeps its own, {saved[name]}; reconstruct the "
                "photo again to change it"
            )


def resume(
    result: Reconstruction,
    stage: int,
    settings: Settings | None = None,
    progress: StageProgress = silent,
    preview: Preview | None = None,
) -> Reconstruction:
    """Run the stages from `stage` (1 to 5) on again.

    They start from the albedo maps, light and mesh of `result`, whatever has been changed in them,
    and use the pixels that its regions have as face; stage 1 starts anew from the fitted head.
    settings: those of `result` if None. Raises SettingsError as `check_resumable`.
    """
    settings = settings or result.settings
    check_resumable(result, stage, settings)
    steps = Steps(
        observe=lambda settings: result.photo,
        fit_head=lambda photo, settings: result.head,
        estimate_conditions=lambda photo, head, settings: result.conditions,
        kept=True,
    )
    again = run_chain(steps, settings, RunRecord(progress), _Start(result, stage), preview)
    return replace(again, metrics=replace(again.metrics, continued_from_stage=stage))


class _Start:
    """Begins where `result` is; nothing is kept of the stages to come."""

    def __init__(self, result: Reconstruction, stage: int) -> None:
        self.result, self.stage = result, stage

    def begin(self, problem: Problem, run: RunRecord) -> Begin | None:
        del run
        result, earlier = self.result, list(TABLE_1)[: self.stage - 1]
        if self.stage == 1:
            return None
        estimate = _estimate(problem, result)
        problem.move(estimate.vertices)
        losses = {name: list(pairs) for name, pairs in result.metrics.losses.items()}
        losses = {name: losses[name] for name in earlier if name in losses}
        return Begin(self.stage - 1, estimate, losses=losses)

    def keep(self, stage: str, problem: Any, estimate: Any, shading: Any, run: Any) -> None:
        """Nothing."""


def _estimate(problem: Problem, result: Reconstruction) -> Estimate:
    """`result` as the stages left it."""
    gain, maps, light = np.float32(result.gain), result.face.maps, result.light

    rows = problem.rows
    return Estimate.of(
        {
            "vertices": result.face.mesh.vertices,
            "log_diffuse": np.log(np.maximum(rows(maps.diffuse_albedo) / gain, _LEAST)),
            "log_specular": np.log(np.maximum(rows(maps.specular_albedo) / gain, _LEAST)),
            "perturbation": before_relief(problem, rows(maps.perturbation), result.settings.detail),
            "axis": light.axis,
            "log_sharpness": np.log(np.maximum(light.sharpness, _LEAST)),
            "log_amplitude": np.log(np.maximum(light.amplitude * gain, _LEAST_LIGHT)),
        }
    )
