"""Faces in a photo: 478 landmarks in three dimensions, 52 expression scores.

Detector, landmark network (Attention Mesh, Grishchenko et al. 2020) and blendshape network are
off the shelf; the paper's head model is fitted to such output (section 2.1 of the paper takes
its coefficients from a network, docs/method.md says why this project does not).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import FaceError
from .detector import detections
from .networks import BLENDSHAPES, LANDMARKS, network
from .topology import BLENDSHAPE_LANDMARKS, BLENDSHAPE_NAMES, LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from .views import Pyramid, Square

RESOLUTION = 256
MIN_PRESENCE = 0.98

Box = tuple[float, float, float, float]

_MARGIN = 1.5  # region of interest over the face box: what the network was trained on
# The detector's box is rough. Repeating on the region the landmarks themselves span, as trackers
# do, takes the spread of the landmarks under shifts, scales and rolls of the photo from 0.6 to
# 0.25 (once) and 0.14 pixels (twice) of the network's 256.
_REFINEMENTS = 2
# Tried in turn where the eye line of the detector leads to no face: it is poor at large rolls.
_TURNS = np.radians([0, -30, 30, -60, 60])
_CHOICES = ("only", "largest", "left", "right")


@dataclass(frozen=True)
class DetectedFace:
    """One face of a photo.

    landmarks: (478, 3) float32, photo pixels (image frame of `scene/camera.py`); z in the same
        scale, relative, smaller = nearer the camera. 468 on the face, then five per iris.
    blendshapes: 52 scores in [0, 1] under their ARKit names, and `_neutral`.
    score: probability that the landmarks lie on a face.
    box: (left, top, right, bottom) of the landmarks, photo pixels.
    """

    landmarks: np.ndarray
    blendshapes: dict[str, float]
    score: float
    box: Box


def find_faces(rgb: np.ndarray) -> list[DetectedFace]:
    """All faces of a photo, largest first; an empty list where there is none.

    rgb: (H, W, 3) uint8, encoded sRGB, heads rolled by up to 60 degrees. Faces are found from about
    a twentieth of the photo's longer side. Deterministic. Raises FaceError for another shape or
    type of array.
    """
    rgb = np.asarray(rgb)
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or 0 in rgb.shape:
        raise FaceError(
            f"image of shape {rgb.shape} and type {rgb.dtype}: faces are looked for in "
            "(H, W, 3) uint8 sRGB; convert it first"
        )
    pyramid = Pyramid(rgb)
    faces: list[DetectedFace] = []
    for candidates in detections(pyramid):
        for square, _ in candidates:
            face = _read_face(pyramid, square)
            if face is not None and not any(_same(face, other) for other in faces):
                faces.append(face)
        if faces:
            break
    return sorted(faces, key=_area, reverse=True)


def check_choice(which: str | int) -> None:
    """Raise FaceError for a name or number that no photo has a face for."""
    if which not in _CHOICES if isinstance(which, str) else which < 0:
        known = ", ".join(_CHOICES)
        raise FaceError(f"face={which!r}: choose {known}, or a number, 0 the largest", "face")


def choose(faces: list[DetectedFace], which: str | int, source: str) -> DetectedFace:
    """The face that was asked for. Raises FaceError naming the photo and the remedy."""
    check_choice(which)
    if not faces:
        raise FaceError(
            f"{source}: no face found; use a photo in which the face is upright, in focus and at "
            "least 80 pixels wide"
        )
    if which == "only":
        if len(faces) > 1:
            raise FaceError(
                f"{source}: {len(faces)} faces found; choose the face largest, left, right or N (0 "
                f"to {len(faces) - 1}, from large to small), or crop the photo",
                "face",
            )
        return faces[0]
    if which == "largest":
        return faces[0]
    if which in ("left", "right"):
        return (min if which == "left" else max)(faces, key=lambda face: face.box[0] + face.box[2])
    if isinstance(which, int) and 0 <= which < len(faces):
        return faces[which]
    if len(faces) == 1:
        raise FaceError(f"{source}: no face {which!r}; only one found: do not choose", "face")
    raise FaceError(
        f"{source}: no face {which!r}; {len(faces)} found: use largest, left, right or 0 to "
        f"{len(faces) - 1}",
        "face",
    )


def _read_face(pyramid: Pyramid, detected: Square) -> DetectedFace | None:
    for turn in _TURNS:
        roi = replace(detected, side=detected.side * _MARGIN, angle=detected.angle + turn)
        landmarks, score = _run_landmarks(pyramid, roi)
        if score >= MIN_PRESENCE:
            break
    else:
        return None
    for _ in range(_REFINEMENTS):
        refined, refined_score = _run_landmarks(pyramid, _region(landmarks))
        if refined_score < MIN_PRESENCE:
            break
        landmarks, score = refined, refined_score
    (scores,) = network(BLENDSHAPES)(landmarks[BLENDSHAPE_LANDMARKS, :2])
    blendshapes = dict(zip(BLENDSHAPE_NAMES, map(float, scores.ravel()), strict=True))
    left, top = landmarks[:, :2].min(axis=0)
    right, bottom = landmarks[:, :2].max(axis=0)
    return DetectedFace(
        landmarks.astype(np.float32),
        blendshapes,
        score,
        (float(left), float(top), float(right), float(bottom)),
    )


def _run_landmarks(pyramid: Pyramid, roi: Square) -> tuple[np.ndarray, float]:
    """Landmarks (478, 3) in photo pixels and the probability of a face, from one view."""
    view = pyramid.view(roi, RESOLUTION).astype(np.float32) / 255
    coordinates, presence = network(LANDMARKS)(view)[:2]
    points = coordinates.reshape(478, 3).astype(np.float64) / RESOLUTION
    placed = np.column_stack([roi.to_photo(points[:, :2]), points[:, 2] * roi.side])
    return placed, float(1 / (1 + np.exp(-np.float64(presence.item()))))


def _region(landmarks: np.ndarray) -> Square:
    """Region of interest around landmarks: level with the eyes, their extent times the margin."""
    dx, dy = (landmarks[LEFT_EYE_OUTER] - landmarks[RIGHT_EYE_OUTER])[:2]
    level = Square(0, 0, 1, float(np.arctan2(dy, dx)))
    axes = level.to_photo(np.array([[1.5, 0.5], [0.5, 1.5]]))
    along = landmarks[:, :2] @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    x, y = (low + high) / 2 @ axes
    return Square(x, y, float((high - low).max()) * _MARGIN, level.angle)


def _area(face: DetectedFace) -> float:
    left, top, right, bottom = face.box
    return (right - left) * (bottom - top)


def _same(one: DetectedFace, other: DetectedFace) -> bool:
    """Whether either face's centre lies in the other's box: the detector also fires on features
    of a large face, such as its nose and mouth alone."""
    return _centre_inside(one.box, other.box) or _centre_inside(other.box, one.box)


def _centre_inside(inner: Box, outer: Box) -> bool:
    x, y = (inner[0] + inner[2]) / 2, (inner[1] + inner[3]) / 2
    return outer[0] < x < outer[2] and outer[1] < y < outer[3]
