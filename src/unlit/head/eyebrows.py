"""Find the eyebrows of a head, which are no parts of its mesh."""

from __future__ import annotations

import numpy as np
from skimage.measure import points_in_poly

from ..perception.topology import LEFT_EYEBROW, RIGHT_EYEBROW


def eyebrow_vertices(points: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Which vertices (V,) lie inside an eyebrow's outline of landmarks (478, 3), seen frontally."""
    inside = np.zeros(len(vertices), dtype=bool)
    for outline in (RIGHT_EYEBROW, LEFT_EYEBROW):
        polygon = points[list(outline)]
        if np.isfinite(polygon).all():
            near = np.abs(vertices[:, 2] - polygon[:, 2].mean()) < 3
            inside |= near & points_in_poly(vertices[:, :2], polygon[:, :2])
    return inside
