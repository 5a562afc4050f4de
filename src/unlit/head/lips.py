"""Close the lips of a head where the photo's are closed.

A linear model fitted to landmarks that are off by some millimetres leaves a slit between lips
that touch, and a slit shows the dark of the mouth. The two rims are brought together, and the
flesh around them follows with a smooth falloff.
"""

from __future__ import annotations

import numpy as np

from ..perception.topology import LIPS_INNER
from .model import HeadModel

UPPER_RIM = LIPS_INNER[:11]
# From the same corner as UPPER_RIM; both rims contain both corners.
LOWER_RIM = (LIPS_INNER[0], *LIPS_INNER[:10:-1], LIPS_INNER[10])
# How far from the rim the flesh follows, and how far closed rims overlap: a line of contact
# between two triangle meshes would let light through. Centimetres.
_REACH = 0.8
_OVERLAP = 0.03
_SAMPLES = 60


def opening(landmarks: np.ndarray) -> float:
    """Height of the mouth's opening in parts of the mouth's width, of landmarks (478, 2 or 3)."""
    gap = np.linalg.norm(landmarks[list(UPPER_RIM)] - landmarks[list(LOWER_RIM)], axis=-1)[3:8]
    return float(gap.mean() / np.linalg.norm(landmarks[UPPER_RIM[0]] - landmarks[UPPER_RIM[-1]]))


def seal_lips(model: HeadModel, vertices: np.ndarray) -> np.ndarray:
    """Vertices (V, 3), model frame, float32, with the lips' rims moved up and down to meet.

    Lips that already overlap, and models without landmarks on the lips, are left alone.
    """
    rims = model.landmarks(vertices)[[UPPER_RIM, LOWER_RIM]]  # (2, 11, 3)
    if not np.isfinite(rims).all():
        return vertices
    gap = np.maximum(rims[0, :, 1] - rims[1, :, 1] + _OVERLAP, 0)
    # The corners' own points lie beyond the visible slit, whose ends are still open.
    gap[[0, -1]] = 0.7 * gap[[1, -2]]
    upper, lower = (_resampled(rim) for rim in rims)
    along = np.linspace(0, 1, _SAMPLES)
    fine_gap = np.interp(along, np.linspace(0, 1, len(gap)), gap)
    box = np.concatenate([upper, lower])
    near = np.flatnonzero(
        ((vertices > box.min(axis=0) - _REACH) & (vertices < box.max(axis=0) + _REACH)).all(axis=1)
    )
    distances = np.linalg.norm(
        vertices[near][:, None] - np.stack([upper, lower])[:, None], axis=-1
    )  # (2, N, samples)
    nearest = distances.argmin(axis=-1)
    distance = distances.min(axis=-1)
    falloff = np.clip(1 - (distance / _REACH) ** 2, 0, 1) ** 2
    amount = 0.5 * fine_gap[nearest] * falloff
    is_upper = distance[0] < distance[1]
    moved = vertices.copy()
    moved[near, 1] += np.where(is_upper, -amount[0], amount[1])
    return moved


def _resampled(rim: np.ndarray) -> np.ndarray:
    """`rim` (11, 3) at _SAMPLES parameters, linear between its points."""
    places = np.linspace(0, 1, len(rim))
    along = np.linspace(0, 1, _SAMPLES)
    return np.stack([np.interp(along, places, rim[:, axis]) for axis in range(3)], axis=-1)
