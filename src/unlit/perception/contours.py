"""Anti-aliased masks from closed contours of landmarks."""

from __future__ import annotations

import cv2
import numpy as np

_SUPERSAMPLING = 4
_STEPS = 6  # points per landmark on the smoothed contour
_FRACTION_BITS = 6


def smooth_contour(points: np.ndarray) -> np.ndarray:
    """Closed Catmull-Rom curve (N * 6, 2) through the points (N, 2)."""
    before, after, next_ = (np.roll(points, shift, axis=0) for shift in (1, -1, -2))
    t = (np.arange(_STEPS) / _STEPS)[None, :, None]
    b, p, a, n = (x[:, None] for x in (before, points, after, next_))
    curve = 0.5 * (
        2 * p + (a - b) * t + (2 * b - 5 * p + 4 * a - n) * t**2 + (3 * p - b - 3 * a + n) * t**3
    )
    return curve.reshape(-1, 2)


def coverage(contour: np.ndarray, resolution: int) -> np.ndarray:
    """Fraction of each pixel inside a closed contour (N, 2), pixels: (S, S) float32 in [0, 1]."""
    fine = np.zeros((resolution * _SUPERSAMPLING,) * 2, np.uint8)
    # OpenCV puts pixel centres on integers.
    scaled = (np.asarray(contour, np.float64) * _SUPERSAMPLING - 0.5) * 2**_FRACTION_BITS
    limit = 2**24  # keeps far-off points within OpenCV's integers
    cv2.fillPoly(
        fine,
        [np.clip(np.round(scaled), -limit, limit).astype(np.int32)],
        255,
        shift=_FRACTION_BITS,
    )
    return (
        cv2.resize(fine, (resolution, resolution), interpolation=cv2.INTER_AREA).astype(np.float32)
        / 255
    )


def filled(landmarks: np.ndarray, resolution: int, *contours: tuple[int, ...]) -> np.ndarray:
    """(S, S) bool: inside any smooth contour through some of the landmarks (478, 2), pixels."""
    smooth = (smooth_contour(landmarks[list(contour)]) for contour in contours)
    return np.any([coverage(contour, resolution) > 0.5 for contour in smooth], axis=0)


def feather(mask: np.ndarray, sigma: float) -> np.ndarray:
    """Mask (S, S) blurred by a Gaussian of `sigma` pixels."""
    return cv2.GaussianBlur(mask, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
