"""Regions of the face as soft masks: skin, lips, eyes, eyebrows, mouth interior, everything else.

What shows a face, and not hair, glass, cloth or a hand, is the parser's word (`parser.py`; paper,
section 3.1). Within it lips, eyes, eyebrows and the mouth are the landmarks' contours, which are
sharper than the parser.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..color import luminance
from ..errors import FaceError
from .covers import worn
from .measures import (
    above,
    coverage,
    disk,
    face_area,
    face_size,
    feather,
    filled,
    smooth_contour,
    smoothstep,
)
from .mouth import mouth_opening, relative_gap
from .own_colours import by_own_colours
from .parser import CLASSES, parse
from .topology import (
    FACE_OVAL,
    LEFT_EYE,
    LEFT_EYEBROW,
    LEFT_LID_GAP,
    LIPS_INNER,
    LIPS_OUTER,
    NOSE_BASE,
    RIGHT_EYE,
    RIGHT_EYEBROW,
    RIGHT_LID_GAP,
)

#: Those of the face that get maps, in the order of `Regions.weights` and of stage 1's base colours
#: (paper, section 3.1).
REGIONS = ("skin", "lips", "eyes", "eyebrows", "mouth")

# Aperture over width, and blink score, between which an eye counts as closing. Measured: narrow
# laughing eyes have apertures from 0.23 and scores to 0.29.
_APERTURE = (0.08, 0.14)
_BLINK = (0.65, 0.85)
_FEATURE_NAMES = ("lips", "eyes", "eyebrows", "mouth")
# What counts as black, of the face's brightness; as a large part of it, and as the line beside
# it, of its size.
_DARK = 0.02
_DARK_WIDTH = 0.12
_DIM_EDGE = 0.02
_NOISE = 0.01  # standard deviation of the blur against the camera's noise, of the face's size
#: Classes of what covers the skin, and the share from which they count, and count wholly.
_COVERING = {"glasses": ("frame",), "tinted glasses": ("tinted lens", "eyes")}
_SHARE_OF_COVER = (0.2, 0.6)
_SUREST = 90.0  # percentile of a beard's share, below the nose, that stands for a whole beard
_FAINTEST = 0.4  # and the least that may: what is fainter on the whole is skin in part
_ISLAND = 0.08  # side of a square that is no face when it lies alone, of the face's size
_FEATHER = 1 / 300  # standard deviation over the face's size: 1 pixel at 512


@dataclass(frozen=True)
class Regions:
    """Soft masks of one crop.

    weights: (S, S, 6) float32 in [0, 1], in the order skin, lips, eyes, eyebrows, mouth,
        background; they sum to 1 at every pixel. Skin is that of face, ears, neck and a bald scalp,
        with eyelids and stubble; hair, a beard, glasses, clothes and hands are background; eyes
        are the visible eyeballs; mouth is teeth, tongue and the dark between open lips.
    shares: (192, 192, 13) float32 in [0, 1], of each of `parser.CLASSES`, on a coarser grid over
        the same crop, 0 beyond the photo's edge; None where no parser was asked.
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
        """(S, S): all that gets maps: skin, lips, eyes, eyebrows and mouth together."""
        return self.weights[..., : len(REGIONS)].sum(axis=-1)


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
    found = set(worn(shares, landmarks, resolution))
    visible = _visible_face(image, shares, landmarks, found) * inside
    visible *= 1 - _covered(shares, found, resolution)
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
    within = cv2.resize(inside.astype(np.float32), shares.shape[:2], interpolation=cv2.INTER_AREA)
    return Regions(weights, shares * within[..., None])


def beard_share(shares: np.ndarray, landmarks: np.ndarray, resolution: int) -> np.ndarray:
    """(S, S) float32 in [0, 1]: how far each pixel is beard, of a face that was found to have one.

    The parser is seldom sure of a beard: what counts is where it is as sure as it gets here.
    shares: (192, 192, 13), as in Regions. landmarks: (478, 2) pixels.
    """
    below = filled(landmarks, resolution, FACE_OVAL) & ~above(landmarks, resolution, NOSE_BASE)
    share = np.clip(_enlarged(shares, ("beard",), resolution), 0, 1)
    return np.minimum(share / max(np.percentile(share[below], _SUREST), _FAINTEST), 1)


def _visible_face(
    image: np.ndarray, shares: np.ndarray, landmarks: np.ndarray, found: set[str]
) -> np.ndarray:
    """(S, S) float32 in [0, 1]: the share of the face, features and all.

    What the parser says, enlarged, with borders where the photo has them. Where a half of the face
    gets no light, nothing tells it from black hair or a black wall: within the landmarks' oval it
    is taken for skin, as its darkness says where the light is not. What looks in places like a
    beard, or on the forehead like cloth, is skin where no beard and no hat was found (`found`, of
    `covers`); a beard is told like hair.
    """
    resolution = len(image)

    def share(*names: str) -> np.ndarray:
        return np.clip(_enlarged(shares, names, resolution), 0, 1)

    size = face_size(landmarks)
    face, hair = share("skin", *_FEATURE_NAMES), share("hair")
    if "beard" in found:
        beard = beard_share(shares, landmarks, resolution)
        face, hair = np.minimum(face, 1 - beard), np.maximum(hair, beard)
    else:
        face += share("beard")
    if "hat" not in found:
        forehead = above(landmarks, resolution, *RIGHT_EYE, *LEFT_EYE)
        forehead &= face_area(landmarks, resolution)
        face += share("cloth") * feather(forehead.astype(np.float32), _FEATHER * size)
    face = np.clip(face, 0, 1)
    dark = _dark_part(image, landmarks)
    black = dark * np.clip(face + share("background", "hair"), 0, 1)
    face = np.maximum(by_own_colours(image, face, hair, size), black)
    if not dark.any():
        return _without_islands(face, size)
    # Between the dark and the lit part lies a line that is dim, which the parser takes for hair.
    edge = disk(_DIM_EDGE * size)
    return face + cv2.dilate(dark, edge) * (cv2.morphologyEx(face, cv2.MORPH_CLOSE, edge) - face)


def _without_islands(face: np.ndarray, size: float) -> np.ndarray:
    """(S, S) float32: `face` without small islands, as between the hairs of a cropped temple."""
    _, parts, table, _ = cv2.connectedComponentsWithStats((face > 0.5).astype(np.uint8))
    small = table[:, cv2.CC_STAT_AREA] < (_ISLAND * size) ** 2
    small[0] = False  # all that is no face
    rim = disk(3 * _FEATHER * size)
    islands = cv2.dilate(np.isin(parts, np.flatnonzero(small)).astype(np.uint8), rim)
    return np.where(islands > 0, 0, face).astype(np.float32)


def _covered(shares: np.ndarray, found: set[str], resolution: int) -> np.ndarray:
    """(S, S) float32 in [0, 1]: frames, tinted lenses with the eyes that they let through.

    A frame is thinner than a pixel of the parser: where there is one, a small share of it is one.
    """
    names = [name for cover in found for name in _COVERING.get(cover, ())]
    return smoothstep(_enlarged(shares, names, resolution), *_SHARE_OF_COVER)


def _enlarged(shares: np.ndarray, names: Sequence[str], resolution: int) -> np.ndarray:
    """(S, S) float32: the classes' shares together, at the crop's resolution."""
    total = shares[..., [CLASSES.index(name) for name in names]].sum(axis=-1)
    return cv2.resize(total, (resolution, resolution), interpolation=cv2.INTER_CUBIC)


def _dark_part(image: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """(S, S) float32: 1 in large parts of the oval that are all but black, soft at 1 pixel.

    What is narrow, as the gaps between strands of hair, is none.
    """
    size = face_size(landmarks)
    oval = filled(landmarks, len(image), FACE_OVAL)
    seen = feather(luminance(np.maximum(image, 0)), _NOISE * size)
    dark = (seen < _DARK * np.percentile(seen[oval], 90)).astype(np.uint8)
    if not dark[oval].any():
        return np.zeros(oval.shape, np.float32)
    large = (cv2.morphologyEx(dark, cv2.MORPH_OPEN, disk(_DARK_WIDTH / 2 * size)) > 0) & oval
    return feather(large.astype(np.float32), _FEATHER * size)


def _eye_opening(
    landmarks: np.ndarray, contour: tuple[int, ...], gap: tuple[tuple[int, int], ...], blink: float
) -> float:
    """0 for closed lids, which are skin; 1 for an open eye; smooth between."""
    aperture = relative_gap(landmarks, gap, (contour[0], contour[8]))
    return float(smoothstep(aperture, *_APERTURE) * (1 - smoothstep(blink, *_BLINK)))
