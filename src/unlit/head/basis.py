"""Reduce a pile of overlapping, hand-made shape axes to an orthogonal basis of unit variance.

The axes and the covariance of their coefficients define a Gaussian over shapes. Its principal
components, under an inner product weighted by surface area, are the identity basis: orthogonal,
and one unit along each is one standard deviation. Position, orientation and size are taken out
first, since one photo with a given focal length fixes them only in the pose.
"""

from __future__ import annotations

import numpy as np


def vertex_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """A third of the area of the triangles around each vertex, (V,), in squared model units."""
    a, b, c = (vertices[triangles[:, corner]].astype(np.float64) for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 6
    return np.bincount(triangles.ravel(), np.repeat(area, 3), minlength=len(vertices))


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


def principal_combinations(
    axes: np.ndarray, covariance: np.ndarray, weights: np.ndarray, keep: float
) -> np.ndarray:
    """Principal components of the shapes that `axes` (J, V, 3) make, as rows (I, J) over the axes.

    One unit along each is one standard deviation; the largest comes first.
    covariance: (J, J) of the axes' coefficients.  weights: (V,) of the inner product.
    keep: part of the variance to keep, in (0, 1].
    """
    size, directions = np.linalg.eigh(covariance)
    half = directions * np.sqrt(np.maximum(size, 0))
    root = axes.reshape(len(axes), -1) * np.sqrt(np.repeat(weights, 3))
    variance, turned = np.linalg.eigh(half.T @ (root @ root.T) @ half)
    variance, turned = variance[::-1], turned[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(variance) / variance.sum(), keep)) + 1
    return (half @ turned[:, :kept]).T
