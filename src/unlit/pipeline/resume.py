"""Go on from a saved result: the later stages again, started from its maps, light and mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import OutputError, SettingsError
from ..face.reconstruction import Fit, Reconstruction
from ..optimize.problem import Estimate, Problem, Progress
from ..optimize.stages import Begin
from ..perception.regions import Regions
from ..settings.settings import Settings, as_dict, flat, override
from ..settings.table1 import TABLE_1
from .chain import Capture, Head, Preview, solve

#: Darker maps, and lobes, are raised to this, as their logarithms are what is optimised.
_LEAST = 1e-3
_LEAST_LIGHT = 1e-8
#: Settings of the steps before the stages.
_KEPT = {
    *("head_model", "landmark_fit", "shading_fit", "light_color", "light_color_estimate"),
    *("cast_shadow", "first_stage_iterations"),
}


def kept_fit(face: Reconstruction, stage: int, settings: Settings) -> Fit:
    """What the result's own stages started from, if it can be continued like this.

    Raises OutputError for a result that has not kept it, SettingsError for a stage or settings
    that do not go with it.
    """
    if face.fit is None:
        raise OutputError(
            f"the result of {face.photo_name} was saved by an older unlit, which did not keep "
            "what is needed to go on from it; reconstruct the photo again"
        )
    if not 1 <= stage <= len(TABLE_1):
        raise SettingsError(f"stage {stage}: choose 1 to {len(TABLE_1)}")
    earlier = override(Settings(), {name: face.settings[name] for name in _KEPT & {*face.settings}})
    saved = flat(as_dict(earlier)) | {"resolution": len(face.image)}
    for name, wanted in flat(as_dict(settings)).items():
        if name.partition(".")[0] in _KEPT | {"resolution"} and wanted != saved[name]:
            raise SettingsError(
                f"{name}={wanted}: the saved result keeps its own, {saved[name]}; reconstruct the "
                "photo again to change it"
            )
    return face.fit


def continued(
    face: Reconstruction,
    stage: int,
    settings: Settings,
    progress: Progress = lambda stage, iteration, iterations, loss: None,
    preview: Preview | None = None,
) -> Reconstruction:
    """Run the stages from `stage` (1 to 5) on again.

    They start from the albedo maps, light and mesh of `face`, whatever has been changed in them,
    and use the pixels that its regions have as face; stage 1 starts anew from the fitted head.
    Raises what `kept_fit` raises.
    """
    fit, metrics = kept_fit(face, stage, settings), face.metrics
    unit = metrics.get("unit_cd_m2")
    capture = Capture(
        face.photo_name,
        face.image,
        face.camera,
        face.crop,
        Regions(face.regions),
        fit.landmarks,
        face.light.color,
        metrics.get("light_color"),
        unit if isinstance(unit, float) else None,
        face.lit,
    )
    head = Head(
        fit.vertices,
        face.triangles,
        face.uv,
        face.triangle_uv,
        fit.landmark_triangle,
        fit.landmark_barycentric,
        fit.landmarks,
        metrics.get("landmark_residual"),
        metrics.get("head_model"),
    )

    def begin(problem: Problem, seconds: dict[str, float]) -> Begin | None:
        losses: Any = metrics.get("losses")
        if isinstance(losses, dict):
            earlier = list(TABLE_1)[: stage - 1]
            problem.history = {name: losses[name] for name in earlier if name in losses}
        if stage == 1:
            return None
        estimate = _estimate(problem, face)
        problem.move(estimate.vertices)
        return Begin(stage - 1, estimate)

    result = solve(capture, head, settings, progress, preview, begin=begin)
    return replace(result, metrics=result.metrics | {"continued_from_stage": stage})


def _estimate(problem: Problem, face: Reconstruction) -> Estimate:
    """`face` as the stages left it."""
    gain = np.float32(face.gain)

    def rows(image: np.ndarray) -> np.ndarray:
        return image.reshape(-1, *image.shape[2:])[problem.pixel]

    return Estimate.of(
        {
            "vertices": face.vertices,
            "log_diffuse": np.log(np.maximum(rows(face.diffuse_albedo) / gain, _LEAST)),
            "log_specular": np.log(np.maximum(rows(face.specular_albedo) / gain, _LEAST)),
            "perturbation": rows(face.perturbation),
            "axis": face.light.axis,
            "log_sharpness": np.log(np.maximum(face.light.sharpness, _LEAST)),
            "log_amplitude": np.log(np.maximum(face.light.amplitude * gain, _LEAST_LIGHT)),
        }
    )
