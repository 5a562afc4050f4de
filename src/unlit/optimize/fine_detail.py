"""After stage 5: the finest detail of the photo, in normals and albedo (paper, section 3.5), and
the albedo of the open mouth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from ..scene.lobes import CellRadiance
from .estimate import Estimate
from .fine_albedo import fine_albedo
from .highlights import with_highlights
from .mouth_albedo import with_mouth
from .problem import Problem
from .relief import with_relief
from .shade_detail import with_detail_of_shade
from .shading import Shading

mi = mitsuba()


def with_fine_detail(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """First the relief, then the albedo under its shading; `shading` is left with its normals.

    Last, what of that albedo is a highlight goes to the specular one.
    """
    settings = problem.settings.detail
    radiance = CellRadiance(shading.cells).of(estimate.light())

    def shades(estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """E and S, (P, 3)."""
        maps = problem.maps(estimate)
        shading.points = problem.points(*problem.bent_normals(maps))
        shading.update(radiance, maps)
        e, s = shading.shade(radiance)
        return _rows(e), _rows(mi.Color3f(s))

    e, _ = shades(estimate)
    relief = with_relief(problem, _rows(estimate.perturbation), e.mean(axis=1), settings)
    estimate = replace(estimate, perturbation=device(mi.Vector3f, relief))
    e, s = shades(estimate)
    albedo, specular = (np.exp(_rows(x)) for x in (estimate.log_diffuse, estimate.log_specular))
    gloss = specular[:, None] * s
    albedo = fine_albedo(problem, albedo, gloss, e, settings)
    albedo = with_detail_of_shade(problem, albedo, gloss, e, settings)
    albedo = with_mouth(problem, albedo, gloss, e)
    albedo, specular = with_highlights(problem, albedo, specular, e, s, settings)
    return replace(
        estimate,
        log_diffuse=device(mi.Color3f, np.log(albedo)),
        log_specular=device(mi.Float, np.log(specular)),
    )


def _rows(values: Any) -> np.ndarray:
    return np.asarray(values.numpy().T)
