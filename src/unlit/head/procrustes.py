"""Align points with points of the same number."""

from __future__ import annotations

import numpy as np


def procrustes(
    source: np.ndarray, goal: np.ndarray, weights: np.ndarray | None = None
) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation (3, 3) and shift (3,) that bring points `source` (N, 3) nearest to `goal`.

    goal = scale * source @ rotation.T + shift, by least squares.
    weights: (N,) of the squares, summing to 1; all the same if None.
    """
    weights = np.full(len(source), 1 / len(source)) if weights is None else weights
    a, b = source - weights @ source, goal - weights @ goal
    u, sizes, vt = np.linalg.svd((b * weights[:, None]).T @ a)
    flip = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * flip) @ vt
    scale = float(sizes @ flip / np.sum(weights[:, None] * a**2))
    return scale, rotation, weights @ goal - scale * rotation @ (weights @ source)
