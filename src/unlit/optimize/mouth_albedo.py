"""The albedo of teeth, gums and tongue: the photo over what light reaches them, smoothly.

How deep teeth stand behind the lips is known to some millimetres only, and so is the light there:
where it is dim, stages 2 to 5 carry the lips' colour on into the mouth. But no smoothness holds
between lips and teeth, and most of what is seen in a mouth is teeth's own. So there the albedo is

    rho_d = (I - rho_s S) / max(E, mean E, the dimmest light that is told from the dark)

up to that of a very white tooth: its hue is the photo's, as the hue of light that has met lips is
no better known than how much of it there is.
"""

from __future__ import annotations

import numpy as np

from ..perception.regions import REGIONS
from .fine_scale import body_of, local_mean
from .problem import Problem

#: Of the diffuse shading, where the best-lit skin has 1: what is dimmer counts as this.
_DIMMEST = 0.25
#: Of the stages' albedo, which is some 1 / 0.7 of the true one (face/gain.py).
_DARKEST, _PALEST = 0.01, 1.2
_LENGTH = 6.0  # of the mean, pixels of a crop of 512


def with_mouth(
    problem: Problem, albedo: np.ndarray, gloss: np.ndarray, e: np.ndarray
) -> np.ndarray:
    """Diffuse albedo (P, 3), linear, with that of the mouth's inside.

    albedo: (P, 3) diffuse. gloss: (P, 3), rho_s S. e: (P, 3) diffuse shading, where the best-lit
    skin has 1. Where no mouth is seen open the albedo is returned as it is.
    """
    share = problem.regions[:, REGIONS.index("mouth")]
    if not share.any():
        return albedo
    grey = e.mean(axis=1)
    # Where the mesh's lips stand before the photo's teeth there is more light than around.
    level = np.maximum(grey, local_mean(problem, grey, share, _LENGTH))
    body = body_of(problem.rows(problem.observation.image), gloss)
    own = body / np.maximum(level, _DIMMEST)[:, None]
    own *= np.minimum(1, _PALEST / np.maximum(own.max(axis=1, keepdims=True), 1e-6))
    mixed = albedo + share[:, None] * (np.maximum(own, _DARKEST) - albedo)
    return np.asarray(mixed, np.float32)
