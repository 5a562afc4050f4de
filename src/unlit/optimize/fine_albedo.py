"""The finest detail of well-lit skin: what smoothness has taken from it, back from the photo.

The smoothness of stages 2 to 5 keeps shading out of the albedo. Shading is coarse; at the finest
scales it takes pores and freckles instead. There the albedo is the photo over the shading:

    rho_d' = rho_d exp(w fine(ln((I - rho_s S) / (rho_d E))))
"""

from __future__ import annotations

import numpy as np

from ..settings.detail import FineDetail
from .fine_scale import body_of, local_mean, recorded
from .problem import Problem

#: Diffuse shading between which pixels begin to count; shares of gloss between which they cease
#: to.
_LIT = (0.08, 0.2)
_GLOSSY = (0.3, 0.8)
_LEAST = 1e-5


def fine_albedo(
    problem: Problem,
    albedo: np.ndarray,
    gloss: np.ndarray,
    e: np.ndarray,
    settings: FineDetail,
) -> np.ndarray:
    """Diffuse albedo (P, 3) with the finest detail of the photo.

    albedo: (P, 3) diffuse. gloss: (P, 3), rho_s S. e: (P, 3) diffuse shading, where the best-lit
    skin has 1.
    """
    image = problem.rows(problem.observation.image)
    level = e.mean(axis=1)
    lit = np.clip((level - _LIT[0]) / (_LIT[1] - _LIT[0]), 0, 1)
    share = gloss.mean(axis=1) / np.maximum(image.mean(axis=1), 1e-4)
    shown = 1 - np.clip((share - _GLOSSY[0]) / (_GLOSSY[1] - _GLOSSY[0]), 0, 1)
    given = problem.rows(problem.observation.weight)
    weight = np.where(recorded(image), given * lit * shown, 0)
    body = np.maximum(body_of(image, gloss), _LEAST)
    left = np.log(body / np.maximum(albedo * e, _LEAST))
    fine = left - local_mean(problem, left, weight, settings.albedo_length)
    fine = np.clip(fine, -settings.most, settings.most)
    return np.asarray(albedo * np.exp(weight[:, None] * fine), np.float32)
