"""Regions of the skin on a head model, as smooth weights of its vertices.

Where skin is, and what of it are lips, eyes and brows, the photo says (perception/regions.py).
Which skin it is, the head knows: nose, forehead and cheeks differ in gloss, but no edge in a photo
parts them. They are drawn on the neutral head with the landmarks, seen from the front, and let
diffuse over its surface, so that values that are given by region change smoothly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from skimage.measure import points_in_poly

from .model import VERTEX_REGIONS, HeadModel

#: In the order of the weights; rest: neck and scalp.
SKIN_REGIONS = ("forehead", "nose", "cheeks", "lids", "chin", "upper_lip", "ears", "rest")

#: Standard deviation of what each border is smoothed by, cm, and in how many steps.
SMOOTHNESS = 0.6
_STEPS = 3

# fmt: off
# Below the forehead, from temple to temple, along the lower edges of the brows.
_BROW_LINE = (162, 46, 53, 52, 65, 55, 168, 285, 295, 282, 283, 276, 389)
# Closed, of landmarks; the earlier ones lie on top.
_CONTOURS = {
    "nose": (
        (168, 193, 245, 188, 174, 217, 126, 209, 129, 64, 98, 97, 2,
         326, 327, 294, 358, 429, 355, 437, 399, 412, 465, 417),
    ),
    "lids": (
        (46, 53, 52, 65, 55, 193, 244, 233, 232, 231, 230, 229, 228, 31, 35, 124),
        (276, 283, 282, 295, 285, 417, 464, 453, 452, 451, 450, 449, 448, 261, 265, 353),
    ),
    "upper_lip": (
        (2, 97, 98, 203, 206, 216, 57, 61, 78, 191, 80, 81, 82, 13,
         312, 311, 310, 415, 308, 291, 287, 436, 426, 423, 327, 326),
    ),
    "chin": (
        (57, 61, 78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308, 291, 287,
         422, 430, 394, 379, 378, 400, 377, 152, 148, 176, 149, 150, 169, 210, 202),
    ),
}
# fmt: on
# Of what is no skin of the face, or is skin only where the photo differs from the head.
_OTHERS = {"scalp": "rest", "neck": "rest", "ears": "ears", "eyes": "lids"}
_OTHERS |= {"mouth": "chin", "teeth": "chin"}


def skin_regions(model: HeadModel) -> np.ndarray | None:
    """Weights (V, 8) float32 in [0, 1], sum 1, of SKIN_REGIONS at the vertices of `model`.

    None for a model that lacks landmarks which draw them.
    """
    points = model.landmarks(model.neutral)
    drawn = [*_BROW_LINE, *(i for outlines in _CONTOURS.values() for one in outlines for i in one)]
    if not np.isfinite(points[drawn]).all():
        return None
    xy = model.neutral[:, :2]
    line = points[list(_BROW_LINE)]
    above = xy[:, 1] > np.interp(xy[:, 0], line[:, 0], line[:, 1])
    label = np.where(above, SKIN_REGIONS.index("forehead"), SKIN_REGIONS.index("cheeks"))
    for name, outlines in reversed(_CONTOURS.items()):
        for outline in outlines:
            label[points_in_poly(xy, points[list(outline), :2])] = SKIN_REGIONS.index(name)
    for part, name in _OTHERS.items():
        here = model.vertex_region == VERTEX_REGIONS.index(part)
        label[here] = SKIN_REGIONS.index(name)
    sharp = np.eye(len(SKIN_REGIONS))[label]
    return _diffused(sharp, model.neutral, model.triangles).astype(np.float32)


def _diffused(values: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """`values` (V, C) after heat has flowed over the mesh (V, 3), (F, 3) for a while.

    Conductances are those of equilateral triangles, never negative: no value leaves the range of
    those around, and what sums to 1 stays so.
    """
    count = len(vertices)
    a, b, c = (vertices[triangles[:, i]].astype(np.float64) for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    square = ((vertices[sides[:, 0]] - vertices[sides[:, 1]]).astype(np.float64) ** 2).sum(axis=1)
    flow = 2 / 3 * np.repeat(area, 3) / np.maximum(square, 1e-8)
    graph = sp.coo_matrix((flow, sides.T), shape=(count, count)).tocsr()
    graph = graph + graph.T
    mass = np.bincount(triangles.ravel(), np.repeat(area / 3, 3), minlength=count) + 1e-9
    laplacian: Any = sp.diags_array(np.asarray(graph.sum(axis=1)).ravel()) - graph
    step = SMOOTHNESS**2 / 2 / _STEPS
    solver = splu((sp.diags_array(mass) + step * laplacian).tocsc())
    for _ in range(_STEPS):
        values = solver.solve(mass[:, None] * values)
    values = np.maximum(values, 0)
    return values / values.sum(axis=1, keepdims=True)
