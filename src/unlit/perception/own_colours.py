"""The face's border by the colours of this very person.

What the parser is sure of shows what colours the face, the hair and all else have, nearby most of
all. Every pixel's odds of each are then those of the parser times those of its colour, at the
photo's own resolution, so that borders are as sharp as the photo's. A share of 0 or 1 stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .measures import colours, feather

_SURE = 0.8  # share of one from which a pixel shows what it looks like
_LEAST = 0.002  # share of the picture that has to be sure of one for its colours to count
_NEARBY = 0.08  # standard deviation of the weight of sure pixels, of the face's size
_ELSEWHERE = 0.01  # weight of all others together
_GRID = 192  # pixels a side, at most, that the means are taken on
# Standard deviations (log R/G, log B/G, log-luminance) added to what is seen: light differs over a
# face, most of all in brightness.
_SLACK = np.array((0.04, 0.04, 0.3), np.float32)
# Entries of a symmetric matrix of three columns, and which of them stands where.
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
_WEIGHT = 0.5  # of the colours' log-odds
_LIMIT = 4.0


def by_own_colours(
    image: np.ndarray, face: np.ndarray, hair: np.ndarray, size: float
) -> np.ndarray:
    """The face's share of each pixel: (S, S) float32 in [0, 1].

    image: (S, S, 3) linear sRGB. face, hair: (S, S) in [0, 1], the parser's shares; what is neither
    is all else. The parser's word stands where it is sure of too little of the face. size: of the
    face, pixels.
    """
    seen = colours(image)
    rest = np.maximum(1 - face - hair, 0)
    own, of_hair, of_rest = (_Colours.where(seen, share, size) for share in (face, hair, rest))
    if own is None:
        return face.astype(np.float32)
    others = [(hair, of_hair), (rest, of_rest)]
    if of_hair is not None and of_rest is not None:
        # Where hair borders on a wall, pixels hold both, and may look like skin.
        both = hair * rest / np.maximum(hair + rest, 1e-6)
        others = [(hair - both / 2, of_hair), (rest - both / 2, of_rest)]
        others.append((both, of_hair.mixed_with(of_rest)))
    density = own.log_density(seen)
    total = face.copy()
    for share, look in others:
        odds = 0.0 if look is None else look.log_density(seen) - density
        total += share * np.exp(_WEIGHT * np.clip(odds, -_LIMIT, _LIMIT))
    return (face / np.maximum(total, 1e-6)).astype(np.float32)


@dataclass(frozen=True)
class _Colours:
    """Gaussians of colours, one a pixel of a grid: mean (G, G, 3), covariance (G, G, 3, 3)."""

    mean: np.ndarray
    covariance: np.ndarray

    @classmethod
    def where(cls, seen: np.ndarray, share: np.ndarray, size: float) -> _Colours | None:
        """Of the colours (S, S, 3) where the share is sure; None where hardly any is."""
        weight = np.maximum(share - _SURE, 0).astype(np.float32) / (1 - _SURE)
        if weight.mean() < _LEAST:
            return None
        scale = min(1.0, _GRID / len(seen))
        reach = _NEARBY * size * scale

        def on_grid(image: np.ndarray) -> np.ndarray:
            return cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)

        sure = on_grid(weight)
        amount = feather(sure, reach) + _ELSEWHERE

        def mean_of(values: np.ndarray) -> np.ndarray:
            held = on_grid(values * weight)
            return (feather(held, reach) + _ELSEWHERE * held.sum() / sure.sum()) / amount

        mean = np.stack([mean_of(seen[..., i]) for i in range(3)], axis=-1)
        square = np.stack([mean_of(seen[..., i] * seen[..., j]) for i, j in _PAIRS], axis=-1)
        spread = square[..., _SYMMETRIC] - mean[..., :, None] * mean[..., None, :]
        return cls(mean, spread + np.diag(_SLACK**2))

    def mixed_with(self, other: _Colours) -> _Colours:
        """Of both in any share."""
        apart = self.mean - other.mean
        along = apart[..., :, None] * apart[..., None, :]
        within = (self.covariance + other.covariance) / 2
        return _Colours((self.mean + other.mean) / 2, within + along / 12)

    def log_density(self, seen: np.ndarray) -> np.ndarray:
        """(S, S), up to a constant, of colours (S, S, 3)."""
        inverse = np.linalg.inv(self.covariance)
        level = np.log(np.linalg.det(self.covariance))
        shape = seen.shape[1::-1]
        offset = seen - cv2.resize(self.mean, shape)
        distance = np.zeros(seen.shape[:2], np.float32)
        for i, j in _PAIRS:
            entry = cv2.resize(inverse[..., i, j], shape) * (1 if i == j else 2)
            distance += entry * offset[..., i] * offset[..., j]
        return -0.5 * (distance + cv2.resize(level, shape))
