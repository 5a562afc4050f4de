"""A face drawn from formulas, with its landmarks: what lies where is known without any network.

Upright and frontal in a square of SIZE pixels, skin before a plain wall.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from unlit.perception import topology

SIZE = 256
#: Half axes of the face's oval around the middle of the picture, pixels.
WIDE, HIGH = 75.0, 100.0
MIDDLE = np.array([SIZE / 2, SIZE / 2])
#: Heights of eyes and mouth in the picture, and how far the eyes are from the middle, pixels.
EYES, MOUTH, EYE_OFFSET = 110.0, 185.5, 33.0
#: Linear sRGB.
SKIN = np.array([0.5, 0.3, 0.22])
WALL = np.array([0.1, 0.2, 0.4])
LIPS = np.array([0.35, 0.12, 0.1])


def ring(
    count: int, centre: Sequence[float], axes: Sequence[float], outwards: float = -1.0
) -> np.ndarray:
    """`count` points (count, 2) of an ellipse over the top; outwards: -1 starts left, 1 right."""
    angle = 2 * np.pi * np.arange(count) / count
    unit = np.stack([outwards * np.cos(angle), -np.sin(angle)], axis=1)
    return np.asarray(centre) + np.asarray(axes) * unit


def drawn_landmarks(gap: float = 0.0) -> np.ndarray:
    """Landmarks (478, 2); gap: height of the mouth's opening over its width."""
    points = np.tile(MIDDLE, (478, 1))

    def put(indices: tuple[int, ...], places: np.ndarray) -> None:
        points[list(indices)] = places

    angle = 2 * np.pi * np.arange(36) / 36
    oval = np.stack([np.sin(angle), -np.cos(angle)], axis=1) * (WIDE, HIGH)
    put(topology.FACE_OVAL, MIDDLE + oval)
    for side, eye, brow in (
        (-1, topology.RIGHT_EYE, topology.RIGHT_EYEBROW),
        (1, topology.LEFT_EYE, topology.LEFT_EYEBROW),
    ):
        x = MIDDLE[0] + side * EYE_OFFSET
        put(eye, ring(16, (x, EYES), (13, 5), side))
        put(brow, ring(10, (x, EYES - 18), (17, 3), side))
    put(topology.LIPS_OUTER, ring(20, (MIDDLE[0], MOUTH), (26, 12)))
    put(topology.LIPS_INNER, ring(20, (MIDDLE[0], MOUTH), (22, 0)))
    for upper, lower in topology.LIP_GAP:
        points[[upper, lower], 1] = MOUTH + 22 * gap * np.array([-1, 1])
    points[[4, 2, 151]] = (MIDDLE[0], 150), (MIDDLE[0], 162), (MIDDLE[0], 60)
    return points


def inside(indices: tuple[int, ...], landmarks: np.ndarray) -> np.ndarray:
    """Pixels (SIZE, SIZE) of the polygon of these landmarks."""
    mask = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(mask, [np.round(landmarks[list(indices)]).astype(np.int32)], 1)
    return mask > 0


def drawn_face(landmarks: np.ndarray) -> np.ndarray:
    """Picture (SIZE, SIZE, 3) float32, linear sRGB: skin, lips, wall, 3 % of noise."""
    image = np.tile(WALL, (SIZE, SIZE, 1))
    image[inside(topology.FACE_OVAL, landmarks)] = SKIN
    image[inside(topology.LIPS_OUTER, landmarks)] = LIPS
    noise = np.random.default_rng(0).normal(1, 0.03, image.shape)
    return (image * noise).astype(np.float32)
