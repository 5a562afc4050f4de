"""From the stages' last estimate to the result: exact shading, the final gain, NumPy arrays."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import replace
from typing import Any

import numpy as np

from ..face.conditions import Conditions
from ..face.face import Face, Normals
from ..face.gain import peak_luminance
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..face.reconstruction import Images, Metrics, Reconstruction
from ..face.warnings import warnings
from ..machine.runtime import mitsuba
from ..optimize.estimate import Estimate
from ..optimize.problem import Problem
from ..optimize.run_record import RunRecord
from ..optimize.shading import Shading
from ..optimize.solve import Solution
from ..scene.lobes import CellRadiance
from ..scene.maps import Maps

resource: Any = None
with contextlib.suppress(ImportError):  # Unix only
    import resource

mi = mitsuba()


def assemble(
    photo: FacePhoto, head: FittedHead, conditions: Conditions, solution: Solution, run: RunRecord
) -> Reconstruction:
    """Everything as NumPy arrays; `solution` is left as it is.

    Between stages the bounced highlights may be those of a light that has changed by
    `settings.gloss_change` since.
    """
    problem, estimate = solution.problem, solution.estimate
    maps = problem.maps(estimate)
    diffuse_normal, specular_normal = problem.bent_normals(maps)
    gain, images = 1.0, Images(*(np.zeros((*problem.inside.shape, 3), np.float32),) * 3)
    if solution.shading is not None:
        points = problem.points(diffuse_normal, specular_normal)
        shading = solution.shading.at(points)
        gain, estimate, e, s = _with_final_gain(problem, shading, estimate, maps)
        maps = problem.maps(estimate)
        images = _images(conditions, maps, e, s)
    mask = np.where(problem.inside, photo.regions.face, 0).astype(np.float32)
    result = Reconstruction(
        photo,
        head,
        conditions,
        Face(
            photo.camera,
            replace(head.mesh, vertices=np.ascontiguousarray(estimate.vertices.numpy().T)),
            maps,
            Normals(
                specular=problem.image(specular_normal, "zero"),
                diffuse=problem.image(diffuse_normal, "zero"),
            ),
            mask,
        ),
        replace(estimate.light(), color=conditions.light_color),
        images,
        gain,
        problem.settings,
        Metrics(dict(run.losses), dict(run.seconds), _peak_memory()),
    )
    if solution.shading is None:
        return result
    return replace(result, metrics=replace(result.metrics, warnings=warnings(result)))


def _with_final_gain(
    problem: Problem, shading: Shading, estimate: Estimate, maps: Maps
) -> tuple[float, Estimate, np.ndarray, np.ndarray]:
    """The result's gain, the estimate that has it, and its E and S (S, S, 3) in white light.

    maps: of `estimate`.
    """
    e, s = _shade(problem, shading, estimate, maps)
    gain = problem.gain.of_result(maps.diffuse_albedo, e, problem.inside)
    if gain == problem.albedo_gain(maps.diffuse_albedo):  # inter-reflection has it already
        return gain, estimate.with_gain(gain), e / gain, s / gain
    # The light is not divided by the gain alone: the stages had another, and light from skin to
    # skin changes with it.
    changed = estimate.with_gain(gain)
    maps = problem.maps(changed)
    other, _ = _shade(problem, shading, changed, maps, gain=1.0)
    full = [peak_luminance(image[problem.inside]) for image in (e, other)]
    rest = float(np.log(full[0] / (gain * full[1])))
    changed = replace(changed, log_amplitude=changed.log_amplitude + rest)
    return gain, changed, *_shade(problem, shading, changed, maps, gain=1.0)


def _shade(
    problem: Problem,
    shading: Shading,
    estimate: Estimate,
    maps: Maps,
    gain: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Exact E and S of `estimate` under its white light, (S, S, 3); 0 where nothing is seen.

    maps: its own. gain: as for `Shading.update`.
    """
    radiance = CellRadiance(shading.cells).of(estimate.light())
    shading.update(radiance, maps, gain)
    e, s = shading.shade(radiance)
    return problem.image(e, "zero"), problem.image(s, "zero")


def _images(conditions: Conditions, maps: Maps, e: np.ndarray, s: np.ndarray) -> Images:
    """In the light's colour, with the shadow and the tint."""
    remaining = conditions.remaining()
    color = conditions.light_color if remaining is None else conditions.light_color * remaining
    e, s = (x * color for x in (e, s))
    return Images(e, s, maps.diffuse_albedo * e + maps.specular_albedo[..., None] * s)


def _peak_memory() -> float:
    """Peak resident memory of this process, megabytes (10^6); 0 where the system does not tell."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if resource else 0
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
