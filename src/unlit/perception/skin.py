"""Skin or hair: which pixels of the face's outline show the face.

A colour model of the skin is learnt from the cheeks and nose of this very face, one of its
surroundings from a ring around it. Every pixel gets log-odds from the two models and from where
it lies in the face, and a field that joins like neighbours settles the doubtful ones. Colours
are log-chromaticity and log-luminance, where light and shadow mostly shift one channel; that
channel counts little, so that a hard shadow stays skin. GrabCut (Rother et al. 2004), tried
first on the same models, has no term for where a pixel lies and lost foreheads to blond hair.
"""

from __future__ import annotations

import cv2
import numpy as np

from .measures import (
    colours,
    coverage,
    dark_lines,
    disk,
    face_size,
    log_luminance,
    smooth_contour,
    smoothstep,
    upwards,
)
from .topology import (
    CHIN,
    FACE_OVAL,
    HAIRLINE,
    LEFT_CHEEK,
    LEFT_EYE,
    LEFT_EYE_OUTER,
    LEFT_EYEBROW,
    LIPS_OUTER,
    NOSE_BASE,
    NOSE_RIDGE,
    RIGHT_CHEEK,
    RIGHT_EYE,
    RIGHT_EYE_OUTER,
    RIGHT_EYEBROW,
)

_WORKING = 256  # resolution of the decision; a guided filter recovers hair edges
_COMPONENTS = 5
_SEED = 7
_MIN_SEEDS = 60

# Standard deviations (log R/G, log B/G, log-luminance) added to what the samples show: the
# cheeks do not show every light that falls on the forehead.
_SKIN_SLACK = (0.07, 0.07, 0.6)
_OTHER_SLACK = (0.05, 0.05, 0.25)
_SKIN_DISTANCE = 3.0  # squared Mahalanobis distance within which a surrounding pixel is skin
_ANYTHING = 1 / (3.0 * 3.0 * 6.0)  # density of a colour that neither model knows
_ANYTHING_SHARE = 0.05
_COLOUR_LIMIT = 5.0  # of the log-odds from colour

# Log-odds from the place: rising from the outline inwards, falling above the landmarks' oval.
_PLACE_EDGE = -1.0  # at the sides, where hair falls; 0 at chin and forehead
_PLACE_INSIDE = 4.0
_PLACE_DEPTH = 0.22  # of the face's size, where it has risen to the full
_PLACE_FOREHEAD = -2.5  # at the top of the raised outline
_BEARD_TRUST = 0.15  # of adverse colour around the mouth, deep inside

_STRANDS = (0.15, 0.5)  # mean dark-line strength (log units) of smooth skin and of hair
_STRANDS_WEIGHT = 3.0  # of the log-odds against strands at the outline

_COUPLING = 1.2  # of each of eight neighbours of the same colour
_COUPLING_CONTRAST = (0.10, 0.10, 0.35)
_SWEEPS = 20

_FOREHEAD = 0.3  # how far above the landmarks' oval the hairline may lie, of the face's height
_INSET = 0.015  # of the face's size: landmarks on the silhouette are that uncertain


def visible_face(image: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Soft mask (S, S) float32 in [0, 1] of the face not covered by hair.

    image: (S, S, 3) linear sRGB. landmarks: (478, 2) pixels. Soft along hair, 0 beyond the
    outline of the face with the forehead up to the hairline; features of the face count as face.
    """
    resolution = image.shape[0]
    small = _shrink(np.ascontiguousarray(image, np.float32))
    decided = _decide(small, landmarks * (small.shape[0] / resolution))
    mask = cv2.resize(decided, (resolution, resolution), interpolation=cv2.INTER_LINEAR)
    size = face_size(landmarks)
    guide = log_luminance(image)
    mask = cv2.GaussianBlur(mask, (0, 0), 0.008 * size)
    mask = _guided_filter(guide, mask, radius=max(2, round(0.012 * size)))
    mask = smoothstep(mask, 0.35, 0.85)
    _, raised = _outlines(landmarks)
    return (mask * coverage(_inset(raised, _INSET * size), resolution)).astype(np.float32)


def _shrink(image: np.ndarray) -> np.ndarray:
    if image.shape[0] <= _WORKING:
        return image
    return cv2.resize(image, (_WORKING, _WORKING), interpolation=cv2.INTER_AREA)


def _outlines(landmarks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The face oval, and the oval with its upper arc raised to where hairlines may lie."""
    oval = landmarks[list(FACE_OVAL)]
    up = landmarks[HAIRLINE] - landmarks[CHIN]
    eyes = (landmarks[RIGHT_EYE_OUTER] + landmarks[LEFT_EYE_OUTER]) / 2
    # 0 at the level of the eyes, 1 at the top: the temples are raised less than the middle.
    level = (oval - eyes) @ up
    raised = np.clip(level / max(level.max(), 1e-6), 0, 1)
    return smooth_contour(oval), smooth_contour(oval + raised[:, None] * _FOREHEAD * up)


def _decide(image: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Probability of face (S, S) float32 at working resolution; features of the face are filled."""
    resolution = image.shape[0]
    size = face_size(landmarks)
    oval_contour, raised_contour = _outlines(landmarks)

    def filled(contour: np.ndarray) -> np.ndarray:
        return coverage(contour, resolution) > 0.5

    def polygon(*contours: tuple[int, ...]) -> np.ndarray:
        return np.any([filled(landmarks[list(indices)]) for indices in contours], axis=0)

    oval, outline = filled(oval_contour), filled(raised_contour)
    outline |= oval
    seeds = polygon(RIGHT_CHEEK, LEFT_CHEEK, NOSE_RIDGE) & oval
    if seeds.sum() < _MIN_SEEDS:
        return oval.astype(np.float32)
    features = polygon(RIGHT_EYE, LEFT_EYE, RIGHT_EYEBROW, LEFT_EYEBROW, LIPS_OUTER)
    features = cv2.dilate(features.astype(np.uint8), disk(0.04 * size)) > 0
    up = upwards(landmarks)
    centre = (landmarks[HAIRLINE] + landmarks[CHIN]) / 2
    rows, columns = np.indices(oval.shape) + 0.5
    height = columns * up[0] + rows * up[1]

    seen = colours(image)
    skin = _Mixture(seen[seeds], _SKIN_SLACK)
    ring = (cv2.dilate(outline.astype(np.uint8), disk(0.25 * size)) > 0) & ~outline
    ring &= height > landmarks[list(LIPS_OUTER)].mean(axis=0) @ up  # no neck
    ring &= skin.distance(seen) > _SKIN_DISTANCE  # no ears, no bald head
    unlike = _ANYTHING_SHARE * _ANYTHING
    if ring.sum() >= _MIN_SEEDS:
        other = _Mixture(seen[ring], _OTHER_SLACK)
        unlike = unlike + (1 - _ANYTHING_SHARE) * other.density(seen)
    from_colour = np.log(skin.density(seen) + 1e-12) - np.log(unlike + 1e-12)
    from_colour = np.clip(from_colour, -_COLOUR_LIMIT, _COLOUR_LIMIT)
    # Brows, lashes and lips have the colours of hair and make-up, and say nothing.
    from_colour[features] = 0

    depth = cv2.distanceTransform(oval.astype(np.uint8), cv2.DIST_L2, 5) / size
    inside = smoothstep(depth, 0, _PLACE_DEPTH)
    across = np.abs((columns - centre[0]) * up[1] - (rows - centre[1]) * up[0])
    side = smoothstep(across / across[oval].max(), 0.65, 0.9)
    beard = (height < landmarks[NOSE_BASE] @ up) & (from_colour < 0)
    from_colour = np.where(beard, from_colour * (1 + (_BEARD_TRUST - 1) * inside), from_colour)
    above = cv2.distanceTransform((~oval).astype(np.uint8), cv2.DIST_L2, 5)
    above = np.clip(above / (_FOREHEAD * size), 0, 1)
    edge = _PLACE_EDGE * side
    place = edge + (_PLACE_INSIDE - edge) * inside + _PLACE_FOREHEAD * above
    strands = cv2.GaussianBlur(np.minimum(dark_lines(seen[..., 2], size), 1), (0, 0), 0.02 * size)
    texture = _STRANDS_WEIGHT * smoothstep(strands, *_STRANDS) * (1 - inside) * side
    texture[features | (height < landmarks[NOSE_BASE] @ up)] = 0  # a beard has strands too
    odds = from_colour + place - texture
    odds[seeds] = _COLOUR_LIMIT + _PLACE_INSIDE
    odds[~outline] = -(_COLOUR_LIMIT + _PLACE_INSIDE)
    probability = _settle(odds, seen)
    return _tidy(probability, outline, seeds)


class _Mixture:
    """Mixture of Gaussians over the hard clusters of k-means, widened by a slack."""

    def __init__(self, samples: np.ndarray, slack: tuple[float, float, float]) -> None:
        """samples: (N, 3) float32. slack: standard deviations added in quadrature."""
        # k-means in units of the slack, which says which differences matter.
        scaled = np.ascontiguousarray(samples / np.asarray(slack), np.float32)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-3)
        cv2.setRNGSeed(_SEED)
        _, labels, _ = cv2.kmeans(
            scaled, _COMPONENTS, np.empty(0, np.int32), criteria, 1, cv2.KMEANS_PP_CENTERS
        )
        self._parts = []
        for label in range(_COMPONENTS):
            cluster = samples[labels[:, 0] == label].astype(np.float64)
            if not len(cluster):
                continue
            offset = cluster - cluster.mean(axis=0)
            covariance = offset.T @ offset / len(cluster) + np.diag(np.square(slack))
            peak = 1 / np.sqrt((2 * np.pi) ** 3 * np.linalg.det(covariance))
            share = len(cluster) / len(samples)
            self._parts.append((share * peak, cluster.mean(axis=0), np.linalg.inv(covariance)))

    def _distances(self, colours: np.ndarray) -> list[np.ndarray]:
        distances = []
        for _, mean, inverse in self._parts:
            offset = colours - mean
            distances.append(np.sum(offset @ inverse * offset, axis=-1))
        return distances

    def distance(self, colours: np.ndarray) -> np.ndarray:
        """Squared Mahalanobis distance (S, S) to the nearest component."""
        return np.min(self._distances(colours), axis=0)

    def density(self, colours: np.ndarray) -> np.ndarray:
        """Probability density (S, S)."""
        return np.sum(
            [
                part[0] * np.exp(-distance / 2)
                for part, distance in zip(self._parts, self._distances(colours), strict=True)
            ],
            axis=0,
        )


def _settle(odds: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Probabilities (S, S) of a contrast-sensitive Potts field with these log-odds, mean field."""
    scaled = (colours / np.asarray(_COUPLING_CONTRAST, np.float32)).astype(np.float32)
    shifts = [(0, 1), (1, 0), (1, 1), (1, -1)]
    rows, columns = odds.shape
    links = []
    for down, right in shifts:
        here = (slice(0, rows - down), slice(max(0, -right), columns - max(0, right)))
        there = (slice(down, rows), slice(max(0, right), columns - max(0, -right)))
        difference = np.sum((scaled[here] - scaled[there]) ** 2, axis=-1)
        links.append((here, there, _COUPLING * np.exp(-difference / 2) / np.hypot(down, right)))
    odds = odds.astype(np.float32)
    field = odds
    for _ in range(_SWEEPS):
        spin = np.tanh(field / 2)
        field = odds.copy()
        for here, there, weight in links:
            field[here] += weight * spin[there]
            field[there] += weight * spin[here]
    return 1 / (1 + np.exp(-field))


def _tidy(probability: np.ndarray, outline: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The part of the face that holds the seeds, without holes.

    Hair and hands come in over the outline; what is cut out inside is a nostril, a shadow, a mole
    or an eye's surroundings, and belongs to the face.
    """
    face = (probability > 0.5) | seeds
    _, parts = cv2.connectedComponents(face.astype(np.uint8), connectivity=4)
    kept = np.isin(parts, np.unique(parts[seeds]))
    _, gaps = cv2.connectedComponents((~kept).astype(np.uint8), connectivity=4)
    enclosed = ~kept & ~np.isin(gaps, np.unique(gaps[~outline]))
    near = cv2.dilate(kept.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(enclosed, 1.0, np.where(near, probability, 0.0)).astype(np.float32)


def _inset(contour: np.ndarray, distance: float) -> np.ndarray:
    """Contour (N, 2) drawn in towards its centroid by about `distance` pixels."""
    offset = contour - contour.mean(axis=0)
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    return contour - offset * (distance / np.maximum(length, distance))


def _guided_filter(guide: np.ndarray, mask: np.ndarray, radius: int) -> np.ndarray:
    """Mask made to follow the edges of the guide (He et al. 2010); both (S, S)."""

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.blur(values, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REFLECT)

    mean_guide, mean_mask = mean(guide), mean(mask)
    covariance = mean(guide * mask) - mean_guide * mean_mask
    variance = mean(guide * guide) - mean_guide**2
    slope = covariance / (variance + 1e-2)
    return mean(slope) * guide + mean(mean_mask - slope * mean_guide)
