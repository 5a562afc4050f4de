"""Frames drawn on a drawn face: found where they cross the bridge, and only the frames."""

from __future__ import annotations

import cv2
import numpy as np

from drawn_face import EYE_OFFSET, EYES, MIDDLE, SIZE, drawn_face, drawn_landmarks
from unlit.perception.glasses import glasses_frames

LANDMARKS = drawn_landmarks()


def worn(bridge: bool, value: float) -> tuple[np.ndarray, np.ndarray]:
    """The face with two round rims, joined over the nose or not, and where they are."""
    frame = np.zeros((SIZE, SIZE), np.uint8)
    for side in (-1, 1):
        centre = round(MIDDLE[0] + side * EYE_OFFSET), round(EYES)
        cv2.circle(frame, centre, 24, 1, 3)
    if bridge:
        ends = [(round(MIDDLE[0]) + x, round(EYES)) for x in (-10, 10)]
        cv2.line(frame, ends[0], ends[1], 1, 3)
    image = drawn_face(LANDMARKS)
    image[frame > 0] = value
    return image, frame > 0


def test_a_bare_face_wears_none() -> None:
    """Not a pixel."""
    assert glasses_frames(drawn_face(LANDMARKS), LANDMARKS).max() == 0


def test_dark_frames_are_found() -> None:
    """Most of the rims and little else; lenses are not frames."""
    image, frame = worn(True, 0.01)
    mask = glasses_frames(image, LANDMARKS)
    assert mask.shape == (SIZE, SIZE) and mask.dtype == np.float32
    assert mask.min() >= 0 and mask.max() <= 1
    assert mask[frame].mean() > 0.6
    near = cv2.dilate(frame.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert mask[~near].max() < 0.1


def test_what_does_not_cross_the_bridge_is_no_glasses() -> None:
    """Rings around the eyes alone, as make-up or tired eyes make them."""
    image, _ = worn(False, 0.01)
    assert glasses_frames(image, LANDMARKS).max() == 0


def test_pale_frames_are_not_found() -> None:
    """As documented: a line that is hardly darker than skin may be a wrinkle."""
    image, _ = worn(True, 0.25)
    assert glasses_frames(image, LANDMARKS).max() == 0
