"""Shape axes that change shape alone, measured by surface area.

Position, orientation and size are taken out of them, since one photo with a given focal length
fixes these only in the pose.
"""

from __future__ import annotations

import numpy as np


def vertex_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """A third of the area of the triangles around each vertex, (V,), in squared model units."""
    a, b, c = (vertices[triangles[:, corner]].astype(np.float64) for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 6
    return np.bincount(triangles.ravel(), np.repeat(area, 3), minlength=len(vertices))


def on_rim(triangles: np.ndarray, count: int) -> np.ndarray:
    """(count,) bool: vertices at an edge that one triangle alone has, of a hole or of the end."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    rim = np.zeros(count, dtype=bool)
    rim[unique[uses == 1]] = True
    return rim


def remove_similarity(axes: np.ndarray, neutral: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Take out of `axes` (J, V, 3) what moves, turns or scales the neutral (V, 3) as a whole.

    weights: (V,) of the least squares fit of the seven motions, at least 0.
    """
    centred = neutral - np.average(neutral, axis=0, weights=weights)
    motions = [np.tile(unit, (len(neutral), 1)) for unit in np.eye(3)]
    motions += [np.cross(unit, centred) for unit in np.eye(3)]
    motions.append(centred)
    motion = np.stack(motions).reshape(7, -1)
    weight = np.repeat(weights, 3)
    flat = axes.reshape(len(axes), -1)
    amounts = np.linalg.solve((motion * weight) @ motion.T, (motion * weight) @ flat.T)
    return (flat - amounts.T @ motion).reshape(axes.shape)
