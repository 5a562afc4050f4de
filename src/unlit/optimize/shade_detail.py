"""The detail of what is dimly lit: eyes, brows, beard and folds, back from the photo.

Where the mesh puts little light, the albedo's level cannot be trusted: a small error of the shading
E is a large one of the albedo. There stages 2 to 5 fill in what is around, and the photo's detail
is lost with it. But the error of E is smooth except at the mesh's own shading edges. So where the
photo recorded something, what is finer there than a length is taken from it,

    rho_d' = rho_d exp(w shrunk(minmod(fine(ln(D / E)), fine(ln D)))),     D = (I - rho_s S) / rho_d

Of the two, with and without the mesh's edges, the smaller, and none where they differ in sign:
where an edge of the mesh's shading stands beside the photo's, neither makes a seam. What is as
small as errors of shading are on skin goes, and colour with it, which is noise there.
"""

from __future__ import annotations

import numpy as np

from ..perception.regions import REGIONS
from ..settings.detail import FineDetail
from .fine_scale import body_of, local_mean, saturated
from .problem import Problem

#: Linear value of the photo's brightest channel from which a dark pixel tells detail from noise.
_ABOVE_NOISE = 0.02
_LEAST = 1e-5


def with_detail_of_shade(
    problem: Problem, albedo: np.ndarray, gloss: np.ndarray, e: np.ndarray, settings: FineDetail
) -> np.ndarray:
    """Diffuse albedo (P, 3) with the photo's detail where the light is dim.

    albedo: (P, 3) diffuse. gloss: (P, 3), rho_s S. e: (P, 3) diffuse shading, where the best-lit
    skin has 1.
    """
    image = problem.rows(problem.observation.image)
    dim, bright = settings.shade
    shade = np.clip((bright - e.mean(axis=1)) / max(bright - dim, 1e-6), 0, 1)
    told = np.clip(image.max(axis=1) / _ABOVE_NOISE, 0, 1) * (problem.weight.numpy() > 0)
    told = told * ~saturated(image)
    seen = np.log(np.maximum(body_of(image, gloss), _LEAST) / np.maximum(albedo, _LEAST))

    def fine(values: np.ndarray) -> np.ndarray:
        return values - local_mean(problem, values, told, settings.shade_length)

    by_photo = fine(seen.mean(axis=1))
    by_albedo = fine(seen - np.log(np.maximum(e, _LEAST)))
    grey = by_albedo.mean(axis=1)
    error = settings.shade_error * problem.regions[:, REGIONS.index("skin")]
    kept = _shrunk(_minmod(grey, by_photo), error)
    share = np.clip(np.abs(kept) / np.maximum(np.abs(grey), 1e-3), 0, 1)
    detail = share[:, None] * (by_albedo - grey[:, None]) + kept[:, None]
    low, high = settings.shade_range
    changed = albedo * np.exp((told * shade)[:, None] * np.clip(detail, low, high))
    return np.asarray(np.minimum(changed, problem.settings.max_diffuse), np.float32)


def _shrunk(values: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Nearer to 0 by `by`, or just there."""
    return np.sign(values) * np.maximum(np.abs(values) - by, 0)


def _minmod(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The one of smaller size where the signs agree, 0 elsewhere."""
    return np.where(a * b > 0, np.sign(a) * np.minimum(np.abs(a), np.abs(b)), 0)
