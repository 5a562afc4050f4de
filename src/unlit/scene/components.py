"""The pieces of a mesh that hang together."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components


def components(triangles: np.ndarray, count: int) -> np.ndarray:
    """Number of the connected component of each of `count` vertices, (V,) from 0.

    triangles: (F, 3) int. A vertex that no triangle has is a component of its own.
    """
    edges = triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
