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


def lids_outside_eyes(model: HeadModel, vertices: np.ndarray) -> np.ndarray:
    """Vertices (V, 3), model frame, with what sank into an eyeball moved out to its surface.

    An eyeball is the connected piece of the mesh that carries the landmark of the iris. Models
    whose eyes are part of the skin are left alone.
    """
    edges = model.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(vertices)
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    piece = connected_components(graph, directed=False)[1]
    moved = vertices.copy()
    for iris in _IRISES:
        triangle = model.landmark_triangle[iris]
        if triangle < 0:
            continue
        ball = piece == piece[model.triangles[triangle, 0]]
        centre = vertices[ball].mean(axis=0)
        radius = np.linalg.norm(vertices[ball] - centre, axis=-1)
        if radius.max() > _LARGEST_RADIUS:
            continue
        arm = moved - centre
        distance = np.linalg.norm(arm, axis=-1)
        surface = radius.max() + _CLEARANCE
        sunk = ~ball & (distance < surface)
        moved[sunk] = centre + arm[sunk] * (surface / np.maximum(distance[sunk], 1e-6))[:, None]
    return moved
