"""The fine part of the normals as a relief: what is a gradient of one height, and no pigment.

Stages 4 and 5 find a perturbation of the normal in every pixel by itself, and its cost holds it at
a third to a fifth of the truth (docs/lab/method-notes-detail.md). Two facts of physics tell relief
from noise and paint: normals of a surface are the gradient of a height; and shading under one light
changes no chromaticity, which pigments do. What both leave is scaled up.
"""

from __future__ import annotations

import numpy as np

from ..perception.regions import REGIONS
from ..scene.height import PixelFrames
from ..settings.detail import FineDetail
from .fine_scale import local_mean, recorded
from .problem import Problem

#: Skin and lips have relief that is seen; brows and eyes have hair and gloss.
_SURE = 0.9
#: Blur of chroma against noise, and reach of a pigment's edge; pixels of a crop of 512.
_CHROMA_BLUR, _PIGMENT_REACH = 0.7, 1.2


def with_relief(
    problem: Problem, perturbation: np.ndarray, e: np.ndarray, settings: FineDetail
) -> np.ndarray:
    """The perturbation (P, 3) with its fine part turned into that of a relief.

    e: (P,) diffuse shading, mean of the channels; the best-lit skin has 1.
    """
    if settings.relief == 1:
        return perturbation
    fine = fine_part(problem, perturbation, settings)
    frames = pixel_frames(problem)
    facing = frames.trust
    seen = _has_relief(problem) & (e > settings.darkest)
    plain = np.where(seen, facing * _no_pigment(problem, seen, settings), 0)
    height = frames.height_of(fine * plain[:, None], np.where(seen, np.maximum(facing, 0.05), 0))
    relief = settings.relief * frames.perturbation_of(height)
    return np.asarray(perturbation - fine + np.where(seen[:, None], relief, 0), np.float32)


def before_relief(problem: Problem, perturbation: np.ndarray, settings: FineDetail) -> np.ndarray:
    """Near what `with_relief` made `perturbation` (P, 3) of: a run that goes on begins there."""
    if not settings.relief:
        return perturbation
    fine = fine_part(problem, perturbation, settings)
    return np.asarray(perturbation + (1 / settings.relief - 1) * fine, np.float32)


def fine_part(problem: Problem, values: np.ndarray, settings: FineDetail) -> np.ndarray:
    """Of rows (P, C), what is finer than the settings' length."""
    return values - local_mean(problem, values, np.ones(len(values)), settings.relief_length)


def pixel_frames(problem: Problem) -> PixelFrames:
    """Of the mesh as it is."""
    points = problem.points()
    position, normal = points.position.numpy().T, points.specular_normal.numpy().T
    return PixelFrames.of(problem.camera, problem.pixel, position, normal)


def _has_relief(problem: Problem) -> np.ndarray:
    """(P,) bool: skin and lips that the photo recorded."""
    shares = problem.regions[:, REGIONS.index("skin")] + problem.regions[:, REGIONS.index("lips")]
    seen = recorded(problem.rows(problem.observation.image)) & (problem.weight.numpy() > 0)
    return np.asarray((shares > _SURE) & seen)


def _no_pigment(problem: Problem, seen: np.ndarray, settings: FineDetail) -> np.ndarray:
    """(P,) in [0, 1]: 0 where colour changes more than it does elsewhere on this skin."""
    if not seen.any():
        return np.ones(len(seen))
    logs = np.log(np.maximum(problem.rows(problem.observation.image), 2e-3))
    ratios = np.stack([logs[:, 0] - logs[:, 1], (logs[:, 1] - logs[:, 2]) / 1.5], axis=1)
    weight = seen.astype(np.float32)
    fine = ratios - local_mean(problem, ratios, weight, settings.relief_length / 2)
    fine = local_mean(problem, fine, weight, _CHROMA_BLUR)
    contrast = (fine**2).sum(axis=1)
    usual = np.sqrt(np.median(contrast[seen]))
    near = np.sqrt(local_mean(problem, contrast, weight, _PIGMENT_REACH))
    return np.asarray(1 / (1 + (near / max(settings.pigment * usual, 1e-6)) ** 4))
