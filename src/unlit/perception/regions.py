"""Regions of the face as soft masks: skin, lips, eyes, eyebrows, mouth interior, everything else.

Lips, eyes, eyebrows and the mouth are the landmarks' contours; skin is what `skin.py` leaves
of the rest of the face, without glasses (`glasses.py`, and what the network of `parser.py` sees of
them). Section 3.1 of the paper takes such a segmentation from a face parser.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import FaceError
from .covers import TOLD_BY, worn
from .glasses import glasses_frames
from .measures import coverage, face_size, feather, smooth_contour, smoothstep
from .mouth import mouth_opening, relative_gap
from .parser import CLASSES, parse
from .skin import visible_face
from .topology import (
    LEFT_EYE,
    LEFT_EYEBROW,
    LEFT_LID_GAP,
    LIPS_INNER,
    LIPS_OUTER,
    RIGHT_EYE,
    RIGHT_EYEBROW,
    RIGHT_LID_GAP,
)

#: Those of the face that get maps, in the order of `Regions.weights` and of stage 1's base colours
#: (paper, section 3.1).
REGIONS = ("skin", "lips", "eyes", "eyebrows")

# Aperture over width, and blink score, between which an eye counts as closing. Measured: narrow
# laughing eyes have apertures from 0.23 and scores to 0.29.
_APERTURE = (0.08, 0.14)
_BLINK = (0.65, 0.85)
_GLASSES = (0.2, 0.6)  # share from which the parser's glasses count, and count wholly
_FEATHER = 1 / 300  # standard deviation over the face's size: 1 pixel at 512


@dataclass(frozen=True)
class Regions:
    """Soft masks of one crop.

    weights: (S, S, 6) float32 in [0, 1], in the order skin, lips, eyes, eyebrows, mouth,
        background; they sum to 1 at every pixel. Skin includes a short beard and eyelids; ears,
        neck, hair and glasses are background; eyes are the visible eyeballs; mouth is teeth,
        tongue and the dark between open lips.
    shares: (192, 192, 13) float32 in [0, 1], of each of `parser.CLASSES`, on a coarser grid over
        the same crop; None where no parser was asked.
    """

    weights: np.ndarray
    shares: np.ndarray | None = None

    @property
    def skin(self) -> np.ndarray:
        """(S, S)"""
        return self.weights[..., 0]

    @property
    def lips(self) -> np.ndarray:
        """(S, S)"""
        return self.weights[..., 1]

    @property
    def eyes(self) -> np.ndarray:
        """(S, S)"""
        return self.weights[..., 2]

    @property
    def eyebrows(self) -> np.ndarray:
        """(S, S)"""
        return self.weights[..., 3]

    @property
    def mouth(self) -> np.ndarray:
        """(S, S)"""
        return self.weights[..., 4]

    @property
    def background(self) -> np.ndarray:
        """(S, S)"""
        return self.weights[..., 5]

    @property
    def face(self) -> np.ndarray:
        """(S, S): skin, lips, eyes and eyebrows together."""
        return self.weights[..., :4].sum(axis=-1)


def segment(
    image: np.ndarray, landmarks: np.ndarray, blendshapes: dict[str, float], inside: np.ndarray
) -> Regions:
    """Segment a face crop.

    image: (S, S, 3) linear sRGB. landmarks: (478, 2) pixels of the crop (further columns are
    ignored). blendshapes: the landmarker's scores, of which the eyes' blinks are used. inside:
    (S, S) bool, which pixels of the crop are in the photo. Deterministic. Raises FaceError when
    the shapes do not fit.
    """
    image = np.asarray(image, np.float32)
    landmarks = np.asarray(landmarks, np.float64)[:, :2]
    if image.ndim != 3 or image.shape[0] != image.shape[1] or image.shape[2] != 3:
        raise FaceError(f"crop of shape {image.shape}: segment needs a square (S, S, 3) crop")
    if landmarks.shape != (478, 2):
        raise FaceError(f"landmarks of shape {landmarks.shape}: segment needs (478, 2)")
    resolution = image.shape[0]
    sigma = _FEATHER * face_size(landmarks)

    def mask(indices: tuple[int, ...]) -> np.ndarray:
        return feather(coverage(smooth_contour(landmarks[list(indices)]), resolution), sigma)

    shares = parse(image, landmarks, inside)
    visible = visible_face(image, landmarks) * inside
    visible *= 1 - np.maximum(glasses_frames(image, landmarks), _glasses(shares, landmarks, image))
    mouth = mask(LIPS_INNER) * mouth_opening(image, landmarks)
    lips = mask(LIPS_OUTER)
    right_open = _eye_opening(landmarks, RIGHT_EYE, RIGHT_LID_GAP, blendshapes["eyeBlinkRight"])
    left_open = _eye_opening(landmarks, LEFT_EYE, LEFT_LID_GAP, blendshapes["eyeBlinkLeft"])
    eyes = np.maximum(mask(RIGHT_EYE) * right_open, mask(LEFT_EYE) * left_open)
    brows = np.maximum(mask(RIGHT_EYEBROW), mask(LEFT_EYEBROW))
    # Each region takes what the ones before it have left.
    weights = np.zeros((resolution, resolution, 6), np.float32)
    rest = visible
    for index, region in ((4, mouth), (1, lips), (2, eyes), (3, brows)):
        weights[..., index] = rest * region
        rest = rest * (1 - region)
    weights[..., 0] = rest
    weights[..., 5] = 1 - visible
    return Regions(weights, shares)


def _glasses(shares: np.ndarray, landmarks: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(S, S) float32 in [0, 1]: frames, and tinted lenses with the eyes that they let through."""
    classes = [TOLD_BY[name] for name in worn(shares, landmarks, len(image))]
    if "tinted lens" in classes:
        classes.append("eyes")
    total = shares[..., [CLASSES.index(name) for name in classes]].sum(axis=-1)
    enlarged = cv2.resize(total, image.shape[:2], interpolation=cv2.INTER_CUBIC)
    return smoothstep(enlarged, *_GLASSES)


def _eye_opening(
    landmarks: np.ndarray, contour: tuple[int, ...], gap: tuple[tuple[int, int], ...], blink: float
) -> float:
    """0 for closed lids, which are skin; 1 for an open eye; smooth between."""
    aperture = relative_gap(landmarks, gap, (contour[0], contour[8]))
    return float(smoothstep(aperture, *_APERTURE) * (1 - smoothstep(blink, *_BLINK)))
