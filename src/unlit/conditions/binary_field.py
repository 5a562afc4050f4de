"""A binary field on an image whose neighbours agree, unless the image has an edge between them.

The contrast-sensitive Potts model (Boykov and Jolly 2001), by mean field: soft, and the same in
every run.
"""

from __future__ import annotations

import numpy as np

#: Half of the neighbourhood's side, pixels; least agreement of neighbours across an edge.
_REACH, _LEAST = 2, 0.03


def mean_field(
    evidence: np.ndarray,
    guide: np.ndarray,
    inside: np.ndarray,
    contrast: float,
    agreement: float,
    sweeps: int,
) -> np.ndarray:
    """Probabilities (H, W) of 1.

    evidence: (H, W) log odds of 1 that each pixel has alone. guide: (H, W), whose changes beyond
    `contrast` part neighbours. inside: (H, W) bool, where there is a field. agreement: log odds
    that a neighbour beside adds.
    """
    pairs = []
    for dy in range(_REACH + 1):
        for dx in range(-_REACH, _REACH + 1):
            if (dy, dx) <= (0, 0):
                continue
            here, there = _shifted(guide.shape, dy, dx)
            both = inside[here] & inside[there]
            alike = np.exp(-0.5 * ((guide[there] - guide[here]) / contrast) ** 2) / np.hypot(dy, dx)
            weight = np.maximum(alike, _LEAST) * both
            pairs.append((here, there, (0.5 * agreement * weight).astype(np.float32)))
    alone = evidence.astype(np.float32)
    one = _sigmoid(alone)
    for _ in range(sweeps):
        message, spin = np.zeros_like(one), 2 * one - 1
        for here, there, weight in pairs:
            message[here] += weight * spin[there]
            message[there] += weight * spin[here]
        one = 0.5 * one + 0.5 * _sigmoid(alone + message)
    return one


def _shifted(shape: tuple[int, ...], dy: int, dx: int) -> tuple[tuple[slice, slice], ...]:
    """The pixels that have a neighbour (dy, dx) further, and those neighbours."""
    height, width = shape
    left, right = max(-dx, 0), max(dx, 0)
    here = (slice(0, height - dy), slice(left, width - right))
    there = (slice(dy, height), slice(left + dx, width - right + dx))
    return here, there


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-np.clip(values, -30, 30)))
