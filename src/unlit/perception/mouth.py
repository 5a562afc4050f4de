"""Whether a mouth is open: from the gap between the lips and from what is seen in it.

The landmarks alone do not tell: on closed lips of two colours they part them by as much as on a
slightly open mouth. Teeth are less red than any part of the lips, the dark of an open mouth is
darker than the lips' darkest parts; the share of such pixels between the inner contours was
0.56 and more on open mouths and 0.23 and less on closed ones, under even light and under hard
light from either side.
"""

from __future__ import annotations

import cv2
import numpy as np

from .measures import colours, disk, face_size, filled, smoothstep
from .topology import LIP_GAP, LIPS_INNER, LIPS_OUTER

# Mean gap over the mouth's width. Closed lips measured up to 0.016; wide open needs no such pixels.
_GAP = (0.02, 0.04)
_WIDE = (0.3, 0.4)
_UNLIKE_LIPS = (0.25, 0.45)
_PALER = 0.05  # log R/G under the lips' 5th percentile
_DARKER = 0.5  # log-luminance under the lips' 2nd percentile
_MIN_PIXELS = 10


def relative_gap(
    landmarks: np.ndarray, pairs: tuple[tuple[int, int], ...], corners: tuple[int, int]
) -> float:
    """Mean distance of the pairs of landmarks over the distance of the corners."""
    upper, lower = np.array(pairs).T
    heights = np.linalg.norm(landmarks[upper] - landmarks[lower], axis=1)
    width = np.linalg.norm(landmarks[corners[0]] - landmarks[corners[1]])
    return float(heights.mean() / max(width, 1e-6))


def mouth_opening(image: np.ndarray, landmarks: np.ndarray) -> float:
    """0 for closed lips, 1 for an open mouth, smooth between.

    image: (S, S, 3) linear sRGB. landmarks: (478, 2) pixels.
    """
    gap = relative_gap(landmarks, LIP_GAP, (LIPS_INNER[0], LIPS_INNER[10]))
    unlike_lips = smoothstep(_share_unlike_lips(image, landmarks), *_UNLIKE_LIPS)
    return float(smoothstep(gap, *_GAP) * np.maximum(unlike_lips, smoothstep(gap, *_WIDE)))


def teeth(image: np.ndarray, landmarks: np.ndarray, mouth: np.ndarray) -> np.ndarray:
    """(S, S) bool: the pixels of the open mouth that show teeth, paler than lips and not dark.

    image: (S, S, 3) linear sRGB. landmarks: (478, 2) pixels. mouth: (S, S), its share, 0 to 1.
    """
    found = np.zeros(mouth.shape, dtype=bool)
    inside = mouth > 0.5
    lips = _colours_of_lips(image, landmarks)
    if lips is not None and inside.any():
        palest, darkest, seen = lips
        found[inside] = (seen[inside, 0] < palest - _PALER) & (seen[inside, 2] > darkest)
    return found


def _share_unlike_lips(image: np.ndarray, landmarks: np.ndarray) -> float:
    """Share of the pixels between the inner contours that no part of the lips resembles."""
    inner = filled(landmarks, len(image), LIPS_INNER)
    lips = _colours_of_lips(image, landmarks)
    if lips is None or inner.sum() < _MIN_PIXELS:
        return 0.0
    palest, darkest, seen = lips
    inside = seen[inner]
    unlike = (inside[:, 0] < palest - _PALER) | (inside[:, 2] < darkest - _DARKER)
    return float(unlike.mean())


def _colours_of_lips(
    image: np.ndarray, landmarks: np.ndarray
) -> tuple[float, float, np.ndarray] | None:
    """Log R/G of the lips' palest parts, log-luminance of their darkest, and `colours(image)`.

    None where too little of the lips is seen.
    """
    size, resolution = face_size(landmarks), len(image)
    inner = filled(landmarks, resolution, LIPS_INNER).astype(np.uint8)
    outer = filled(landmarks, resolution, LIPS_OUTER).astype(np.uint8)
    lips = (cv2.erode(outer, disk(0.004 * size)) > 0) & ~(cv2.dilate(inner, disk(0.007 * size)) > 0)
    if lips.sum() < _MIN_PIXELS:
        return None
    seen = colours(image)
    palest, darkest = np.percentile(seen[lips][:, 0], 5), np.percentile(seen[lips][:, 2], 2)
    return float(palest), float(darkest), seen
