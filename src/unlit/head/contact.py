"""Contact, of which a linear model knows nothing: of lids with eyeballs, and of closed lips.

A lid that closes along straight paths, as a linear model's does, cuts through the ball that a real
lid slides on: it is moved in front. A model fitted to landmarks that are off by some millimetres
leaves a slit between lips that touch, and a slit shows the dark of the mouth: the two rims are
brought together, and the flesh around them follows with a smooth falloff.
"""

from __future__ import annotations

import numpy as np

from ..perception.topology import LEFT_EYE, LIPS_INNER, RIGHT_EYE
from ..scene.components import components
from .model import HeadModel

# The landmarker's points in the middle of the irises, right and left.
_IRISES = (468, 473)
# Thickness left between ball and lid, and a bound on what counts as an eyeball; centimetres.
_CLEARANCE = 0.02
_LARGEST_RADIUS = 2.0

UPPER_RIM = LIPS_INNER[:11]
# From the same corner as UPPER_RIM; both rims contain both corners.
LOWER_RIM = (LIPS_INNER[0], *LIPS_INNER[:10:-1], LIPS_INNER[10])
#: Of the eyes, right and left, from the outer corner to the inner one, upper and lower.
LID_RIMS = tuple((eye[:9], (eye[0], *eye[:7:-1])) for eye in (RIGHT_EYE, LEFT_EYE))
# How far from the rim the flesh follows, and how far closed rims overlap: a line of contact
# between two triangle meshes would let light through. Centimetres.
_REACH, _LID_REACH = 0.8, 0.4
_OVERLAP = 0.03
_SAMPLES = 60


def pieces(model: HeadModel) -> np.ndarray:
    """Number of the connected piece of the mesh that each vertex belongs to, (V,)."""
    return components(model.triangles, len(model.neutral))


def eyeballs(model: HeadModel) -> list[np.ndarray]:
    """Vertex masks (V,) of the right and the left eyeball: the pieces that carry the irises.

    Fewer where the model has none, or where its eyes are part of the skin.
    """
    piece = pieces(model)
    carriers = [model.landmark_points.triangle[iris] for iris in _IRISES]
    balls = [piece == piece[model.triangles[carrier, 0]] for carrier in carriers if carrier >= 0]
    return [ball for ball in balls if _sphere(model.neutral[ball])[1] < _LARGEST_RADIUS]


def lids_outside_eyes(model: HeadModel, vertices: np.ndarray) -> np.ndarray:
    """Vertices (V, 3), model frame, with what sank into an eyeball moved out to its surface."""
    moved = vertices.copy()
    for ball in eyeballs(model):
        centre, radius = _sphere(vertices[ball])
        arm = moved - centre
        distance = np.linalg.norm(arm, axis=-1)
        surface = radius + _CLEARANCE
        sunk = ~ball & (distance < surface)
        moved[sunk] = centre + arm[sunk] * (surface / np.maximum(distance[sunk], 1e-6))[:, None]
    return moved


def _sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return centre, float(np.linalg.norm(points - centre, axis=-1).max())


def seal_lips(landmarks: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Vertices (V, 3), model frame, float32, with the lips' rims moved up and down to meet.

    landmarks: (478, 3) on `vertices`. Lips that already overlap, and models without landmarks on
    the lips, are left alone.
    """
    return _meeting(landmarks[[UPPER_RIM, LOWER_RIM]], vertices, _REACH)


def shut_lids(landmarks: np.ndarray, vertices: np.ndarray, left: bool) -> np.ndarray:
    """As `seal_lips`, of one eye's lids; the eyeball moves, too: put it back."""
    return _meeting(landmarks[list(LID_RIMS[left])], vertices, _LID_REACH)


def _meeting(rims: np.ndarray, vertices: np.ndarray, reach: float) -> np.ndarray:
    """`vertices` (V, 3) with the upper and lower rim (2, R, 3) on them moved up and down to meet.

    reach: how far from the rims the surface follows, cm.
    """
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
        ((vertices > box.min(axis=0) - reach) & (vertices < box.max(axis=0) + reach)).all(axis=1)
    )
    distances = np.linalg.norm(
        vertices[near][:, None] - np.stack([upper, lower])[:, None], axis=-1
    )  # (2, N, samples)
    nearest = distances.argmin(axis=-1)
    distance = distances.min(axis=-1)
    falloff = np.clip(1 - (distance / reach) ** 2, 0, 1) ** 2
    amount = 0.5 * fine_gap[nearest] * falloff
    is_upper = distance[0] < distance[1]
    moved = vertices.copy()
    moved[near, 1] += np.where(is_upper, -amount[0], amount[1])
    return moved


def _resampled(rim: np.ndarray) -> np.ndarray:
    """`rim` (R, 3) at _SAMPLES parameters, linear between its points."""
    places = np.linspace(0, 1, len(rim))
    along = np.linspace(0, 1, _SAMPLES)
    return np.stack([np.interp(along, places, rim[:, axis]) for axis in range(3)], axis=-1)
