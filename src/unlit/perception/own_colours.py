"""Skin or hair by the colours of this very person, where the parser is not sure.

What the parser is sure of shows what colour this skin and this hair have in this light. Every
pixel's odds of skin against hair are then those of the parser times those of its colour, at the
photo's own resolution, so that borders are as sharp as the photo's.
"""

from __future__ import annotations

import numpy as np

from .measures import colours

_NEITHER = 1e-3  # share of both below which only colours tell
_SURE = 0.8  # share from which a pixel shows what a class looks like
_LEAST = 300  # pixels of each that are needed
# Standard deviations (log R/G, log B/G, log-luminance) added to what is seen: light differs over a
# face, most of all in brightness.
_SLACK = (0.04, 0.04, 0.3)
_WEIGHT = 0.5  # of the colours' log-odds
_LIMIT = 4.0


def by_own_colours(image: np.ndarray, skin: np.ndarray, hair: np.ndarray) -> np.ndarray:
    """What is skin of skin and hair together: (S, S) float32 in [0, 1].

    image: (S, S, 3) linear sRGB. skin, hair: (S, S) in [0, 1], the parser's shares, which stand
    where it is not sure of enough pixels of both.
    """
    both = skin + hair
    prior = np.where(both > _NEITHER, skin / np.maximum(both, _NEITHER), 0.5)
    seen = colours(image)
    samples = [seen[share > _SURE] for share in (skin, hair)]
    if min(len(some) for some in samples) < _LEAST:
        return prior.astype(np.float32)
    prior = np.clip(prior, 0.01, 0.99)
    odds = _log_density(seen, samples[0]) - _log_density(seen, samples[1])
    odds = _WEIGHT * np.clip(odds, -_LIMIT, _LIMIT) + np.log(prior / (1 - prior))
    return (1 / (1 + np.exp(-odds))).astype(np.float32)


def _log_density(colours: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """(S, S), up to a constant: of a Gaussian of the samples (N, 3), widened."""
    offset = samples - samples.mean(axis=0)
    covariance = offset.T @ offset / len(samples) + np.diag(np.square(_SLACK))
    offset = colours - samples.mean(axis=0)
    distance = np.einsum("...i,ij,...j->...", offset, np.linalg.inv(covariance), offset)
    return -0.5 * (distance + np.log(np.linalg.det(covariance)))
