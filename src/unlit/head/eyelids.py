"""Keep eyelids in front of the eyeballs.

A lid that closes along straight paths, as a linear model's does, cuts through the ball that a
real lid slides on.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .model import HeadModel

# The landmarker's points in the middle of the irises, right and left.
_IRISES = (468, 473)
# Thickness left between ball and lid, and a bound on what counts as an eyeball; centimetres.
_CLEARANCE = 0.02
_LARGEST_RADIUS = 2.0


def eyeballs(model: HeadModel) -> list[np.ndarray]:
    """Vertex masks (V,) of the right and the left eyeball: the pieces that carry the irises.

    Fewer where the model has none, or where its eyes are part of the skin.
    """
    edges = model.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    count = len(model.neutral)
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    piece = connected_components(graph, directed=False)[1]
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
