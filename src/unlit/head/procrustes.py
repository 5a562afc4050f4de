"""Align points with points of the same number."""

from __future__ import annotations

import numpy as np


def procrustes(source: np.ndarray, goal: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation (3, 3) and shift (3,) that bring points `source` (N, 3) nearest to `goal`.

    goal = scale * source @ rotation.T + shift, by least squares.
    """
    a, b = source - source.mean(axis=0), goal - goal.mean(axis=0)
    u, sizes, vt = np.linalg.svd(b.T @ a)
    flip = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * flip) @ vt
    scale = float(sizes @ flip / np.sum(a**2))
    return scale, rotation, goal.mean(axis=0) - scale * rotation @ source.mean(axis=0)
