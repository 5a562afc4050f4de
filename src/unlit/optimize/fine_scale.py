"""What tells the finest detail from the rest: means around a pixel, where the photo recorded it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from .problem import Problem

#: Width of the crop that lengths are for, pixels.
_WIDTH = 512
#: Linear values between which a photo's channels say what they are.
_CRUSHED, _SATURATED = 1e-3, 0.98
#: The least share of the photo that the body of the skin has.
_BODY = 0.3
_LEAST_SHARE = 1e-3


def local_mean(
    problem: Problem, values: np.ndarray, weight: np.ndarray, length: float
) -> np.ndarray:
    """Mean of rows (P, C) or (P,) around each pixel, by `weight` (P,) and a Gaussian.

    length: its standard deviation, pixels of a crop of 512.
    """
    sigma = length * problem.camera.width / _WIDTH

    def blurred(rows: np.ndarray) -> np.ndarray:
        image = problem.image_of(np.asarray(rows, np.float32))
        smooth: Any = ndimage.gaussian_filter(image, (sigma, sigma, 0)[: image.ndim])
        return problem.rows(smooth)

    total, share = blurred((values.T * weight).T), blurred(weight)
    return (total.T / np.maximum(share, _LEAST_SHARE)).T


def recorded(image: np.ndarray) -> np.ndarray:
    """(P,) bool: which of the photo's pixels (P, 3), linear, are neither crushed nor saturated."""
    return np.asarray(~saturated(image) & (image.min(axis=1) > _CRUSHED))


def saturated(image: np.ndarray) -> np.ndarray:
    """(P,) bool: which of the photo's pixels (P, 3), linear, may have been brighter."""
    return np.asarray(image.max(axis=1) >= _SATURATED)


def body_of(image: np.ndarray, gloss: np.ndarray) -> np.ndarray:
    """What the body of the skin has of the photo (P, 3), its gloss (P, 3) taken out: never below
    a share of it, since gloss is not known so well."""
    return np.maximum(image - gloss, _BODY * image)
