"""What real skin shows and the rendered heads do not: freckles, folds, a shaved beard, shine.

Painted into a render where it shows skin, so that the network does not take them for hair, a beard
or glasses. Sizes are those of a random number generator, not of anyone's face.
"""

from __future__ import annotations

import cv2
import numpy as np

from unlit.perception.measures import above, coverage
from unlit.perception.topology import (
    FACE_OVAL,
    LEFT_EYE,
    LEFT_EYEBROW,
    LIPS_OUTER,
    NOSE_BASE,
    RIGHT_EYE,
    RIGHT_EYEBROW,
)

# Landmarks along the folds from the wings of the nose to the chin, right and left.
_FOLDS = ((129, 203, 206, 216, 212, 202), (358, 423, 426, 436, 432, 422))
# From temple to temple: along the top of the oval, and along the brows.
_TOP = (54, 103, 67, 109, 10, 338, 297, 332, 284)
_BROWS = (46, 53, 52, 65, 9, 295, 282, 283, 276)
# Below the eyes, and their outer corners.
_BAGS = ((226, 110, 24, 23, 22, 26, 112), (446, 339, 254, 253, 252, 256, 341))
_SHINY = (10, 151, 9, 6, 4, 5, 50, 280, 117, 346, 18, 67, 297)


def skin_looks(
    landmarks: np.ndarray, size: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Change of the log of the colour (S, S, 3), and shine to add (S, S, 1) in units of white skin.

    landmarks: (478, 2), pixels.
    """
    total = _freckles(size, rng)
    face = float(np.linalg.norm(np.ptp(landmarks, axis=0)))
    if rng.random() < 0.5:
        total -= _lines(landmarks, size, face, rng)[..., None] * (0.8, 1.0, 1.05)
    if rng.random() < 0.35:
        total += _shaved(landmarks, size, face, rng)
    if rng.random() < 0.25:
        total += _made_up(landmarks, size, face, rng)
    shine = np.zeros((size, size, 1), np.float32)
    if rng.random() < 0.4:
        shine = _shine(landmarks, size, face, rng)
    return total.astype(np.float32), shine


def _noise(size: int, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """(S, S) of standard deviation 1."""
    coarse = _coarser(sigma)
    shape = (size // coarse + 1, size // coarse + 1)
    noise = cv2.GaussianBlur(rng.standard_normal(shape, np.float32), (0, 0), sigma / coarse)
    noise = cv2.resize(noise, (size, size)) if coarse > 1 else noise[:size, :size]
    return noise / max(float(noise.std()), 1e-6)


def _blurred(mask: np.ndarray, sigma: float) -> np.ndarray:
    coarse = _coarser(sigma)
    if coarse > 1:
        height, width = mask.shape[:2]
        few = cv2.resize(mask, (width // coarse, height // coarse), interpolation=cv2.INTER_AREA)
        return cv2.resize(cv2.GaussianBlur(few, (0, 0), sigma / coarse), (width, height))
    return cv2.GaussianBlur(mask, (0, 0), max(sigma, 0.3))


def _coarser(sigma: float) -> int:
    """How many pixels a side are one where all is blurred by `sigma`."""
    return max(int(sigma / 2), 1)


def _freckles(size: int, rng: np.random.Generator) -> np.ndarray:
    """Freckles, redness and pores, and now and then a mole."""
    total = np.zeros((size, size, 3), np.float32)
    for sigma in (0.7, 1.5, 4.0, 12.0):
        strength = abs(rng.normal(0, 0.05))
        tint = np.array([0.6, 1.0, 1.0]) * rng.uniform(0.5, 1)
        total += (strength * _noise(size, sigma, rng))[..., None] * tint
    for _ in range(rng.integers(0, 6)):
        x, y = (int(v) for v in rng.uniform(0.3, 0.7, 2) * size)
        spot = np.zeros((size, size), np.float32)
        cv2.circle(spot, (x, y), int(rng.integers(1, 3)), 1.0, -1, cv2.LINE_AA)
        total -= spot[..., None] * rng.uniform(0.2, 0.9)
    return total


def _line(points: np.ndarray, size: int, width: float, rng: np.random.Generator) -> np.ndarray:
    """(S, S): a soft dark line through points (N, 2), and a wider shade beside it."""
    mask = np.zeros((size, size), np.float32)
    fixed = np.round(points * 16).astype(np.int32)
    cv2.polylines(mask, [fixed], False, 1.0, max(1, round(width)), cv2.LINE_AA, 4)
    sharp = _blurred(mask, 0.4 * width)
    wide = _blurred(mask, rng.uniform(1.5, 4) * width)
    wide = np.roll(wide, tuple(rng.integers(-2, 3, 2)), axis=(0, 1))
    return rng.uniform(0.1, 0.9) * sharp + rng.uniform(0, 0.7) * wide


def _lines(landmarks: np.ndarray, size: int, face: float, rng: np.random.Generator) -> np.ndarray:
    """Folds beside the mouth, lines on the forehead, bags below the eyes: (S, S), log units."""
    total = np.zeros((size, size), np.float32)
    jitter = 0.008 * face
    if rng.random() < 0.8:
        end = int(rng.integers(3, 7))
        for fold in _FOLDS:
            points = landmarks[list(fold[:end])] + rng.normal(0, jitter, (end, 2))
            total += _line(points, size, rng.uniform(0.004, 0.012) * face, rng)
    for _ in range(rng.integers(0, 5)):
        height = rng.uniform(0.1, 0.9)
        points = height * landmarks[list(_TOP)] + (1 - height) * landmarks[list(_BROWS)]
        first, last = sorted(rng.choice(9, 2, replace=False))
        points = points[first : last + 1] + rng.normal(0, 0.4 * jitter, (last + 1 - first, 2))
        total += 0.6 * _line(points, size, rng.uniform(0.003, 0.006) * face, rng)
    if rng.random() < 0.5:
        for bag in _BAGS:
            points = landmarks[list(bag)] + rng.normal(0, 0.3 * jitter, (len(bag), 2))
            total += 0.7 * _line(points, size, rng.uniform(0.004, 0.01) * face, rng)
    return total


def _shaved(landmarks: np.ndarray, size: int, face: float, rng: np.random.Generator) -> np.ndarray:
    """The grey shade of a shaved beard, with the dots of its hairs: (S, S, 3)."""
    lower = (~above(landmarks, size, NOSE_BASE)).astype(np.float32)
    lower *= coverage(landmarks[list(FACE_OVAL)], size)
    lower *= 1 - coverage(landmarks[list(LIPS_OUTER)], size)
    place = _blurred(lower, rng.uniform(0.01, 0.05) * face)
    patches = np.clip(1 + rng.uniform(0, 0.5) * _noise(size, 0.05 * face, rng), 0, 2)
    dots = rng.uniform(0, 0.1) * _noise(size, rng.uniform(0.4, 0.9), rng)
    shade = rng.uniform(0.03, 0.3) * patches + dots
    return -(place * shade)[..., None] * np.array([1.0, rng.uniform(0.8, 1), rng.uniform(0.6, 1)])


def _made_up(landmarks: np.ndarray, size: int, face: float, rng: np.random.Generator) -> np.ndarray:
    """Shadow round the eyes and rouge on the cheeks, of any colour: (S, S, 3)."""
    total = np.zeros((size, size, 3), np.float32)
    eyes = np.zeros((size, size), np.float32)
    for eye, brow in ((RIGHT_EYE, RIGHT_EYEBROW), (LEFT_EYE, LEFT_EYEBROW)):
        points = landmarks[[*eye, *brow]].astype(np.float32)
        eyes = np.maximum(eyes, coverage(cv2.convexHull(points)[:, 0], size))
    colour = -np.abs(rng.normal(0, 0.35, 3)) * rng.uniform(0.2, 1.2)
    total += _blurred(eyes, rng.uniform(0.01, 0.03) * face)[..., None] * colour
    for cheek in (50, 280):
        spot = np.zeros((size, size), np.float32)
        x, y = (int(v) for v in landmarks[cheek])
        cv2.circle(spot, (x, y), max(2, round(0.07 * face)), 1.0, -1, cv2.LINE_AA)
        rouge = np.array([0.05, -0.35, -0.25]) * rng.uniform(0, 1)
        total += _blurred(spot, 0.04 * face)[..., None] * rouge
    return total


def _shine(landmarks: np.ndarray, size: int, face: float, rng: np.random.Generator) -> np.ndarray:
    """Highlights of oily skin on forehead, nose and cheeks: (S, S, 1)."""
    total = np.zeros((size, size), np.float32)
    for place in rng.choice(_SHINY, rng.integers(1, 6), replace=False):
        x, y = landmarks[place] + rng.normal(0, 0.03 * face, 2)
        axes = rng.uniform(0.01, 0.08, 2) * face
        spot = np.zeros((size, size), np.float32)
        box = ((float(x), float(y)), tuple(float(a) for a in 2 * axes), rng.uniform(0, 180))
        cv2.ellipse(spot, box, 1.0, -1, cv2.LINE_AA)
        total += rng.uniform(0.05, 0.7) * _blurred(spot, rng.uniform(0.2, 0.9) * axes.min())
    grain = np.clip(1 + rng.uniform(0, 0.5) * _noise(size, 0.8, rng), 0, None)
    return (total * grain)[..., None]
