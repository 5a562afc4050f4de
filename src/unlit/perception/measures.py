"""What the regions are told by: contours, the face's size and upright, colours."""

from __future__ import annotations

import cv2
import numpy as np

from ..color import luminance
from .topology import CHIN, FACE_OVAL, HAIRLINE, LEFT_EYE_OUTER, RIGHT_EYE_OUTER

_SUPERSAMPLING = 4
_STEPS = 6  # points per landmark on the smoothed contour
_FRACTION_BITS = 6
_FOREHEAD = 0.3  # height of a forehead above the oval, of that of the face
_DARK = 0.004  # linear floor under the logarithms, against noise


def tangents(points: np.ndarray) -> np.ndarray:
    """Unit directions (N, 2) along the closed contour through the points (N, 2), at each."""
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    return along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)


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


def face_area(landmarks: np.ndarray, resolution: int) -> np.ndarray:
    """(S, S) bool: the face's oval with its upper arc raised to where hairlines may lie.

    landmarks: (478, 2), pixels.
    """
    oval = landmarks[list(FACE_OVAL)]
    up = landmarks[HAIRLINE] - landmarks[CHIN]
    eyes = (landmarks[RIGHT_EYE_OUTER] + landmarks[LEFT_EYE_OUTER]) / 2
    # 0 at the level of the eyes, 1 at the top: the temples are raised less than the middle.
    level = np.clip((oval - eyes) @ up, 0, None)
    raised = oval + _FOREHEAD * level[:, None] / max(level.max(), 1e-6) * up
    return coverage(smooth_contour(raised), resolution) > 0.5


def feather(mask: np.ndarray, sigma: float) -> np.ndarray:
    """Mask (S, S) blurred by a Gaussian of `sigma` pixels."""
    return cv2.GaussianBlur(mask, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)


def face_size(landmarks: np.ndarray) -> float:
    """Square root of the area of the face oval, pixels: the yardstick of every margin."""
    oval = landmarks[list(FACE_OVAL)]
    x, y = oval[:, 0], oval[:, 1]
    return float(np.sqrt(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2))


def upwards(landmarks: np.ndarray) -> np.ndarray:
    """Unit vector (2,) from the chin to the hairline, pixels of landmarks (478, 2)."""
    up = landmarks[HAIRLINE] - landmarks[CHIN]
    return up / np.linalg.norm(up)


def above(landmarks: np.ndarray, resolution: int, *points: int) -> np.ndarray:
    """(S, S) bool: the pixels that lie higher along the face than some landmarks in the mean.

    landmarks: (478, 2), pixels. points: which of them.
    """
    x, y = upwards(landmarks)
    place = np.arange(resolution) + 0.5
    return x * place + (y * place)[:, None] > (landmarks[list(points)] @ (x, y)).mean()


def colours(image: np.ndarray) -> np.ndarray:
    """(S, S, 3) float32: log(R/G), log(B/G) and log-luminance of linear sRGB."""
    red, green, blue = np.moveaxis(np.log(np.maximum(image, 0) + _DARK), -1, 0)
    bright = np.log(np.maximum(luminance(image), 0) + _DARK)
    return np.stack([red - green, blue - green, bright], axis=-1).astype(np.float32)


def smoothstep(values: np.ndarray | float, low: float, high: float) -> np.ndarray:
    """0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((np.asarray(values) - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def disk(radius: float) -> np.ndarray:
    """Structuring element of that radius in pixels, at least 1."""
    diameter = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
