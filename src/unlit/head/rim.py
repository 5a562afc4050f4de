"""An even rim where a head mesh ends: the neck, cut along the quads it was made of, is jagged.

The rim's vertices move onto the closed curve of their own longest waves, and the surface near it
follows, less and less (a harmonic function of the mesh). It is a matrix, so that one product does
it to a head and to whatever moves it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

#: Waves round the rim that stay, and how many edges from it the surface moves.
_WAVES, _REACH = 3, 10


def even_rim(triangles: np.ndarray, count: int) -> sp.csr_matrix:
    """The matrix (V, V) that evens the rim of a mesh; the identity for one without or with several.

    triangles: (F, 3) int, consistently oriented. count: V.
    """
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    there = set(map(tuple, sides.tolist()))
    following = {a: b for a, b in there if (b, a) not in there}
    rim = _loop(following)
    identity = sp.csr_matrix(sp.identity(count))
    if len(rim) <= 2 * _WAVES:
        return identity
    graph = sp.coo_matrix((np.ones(len(sides)), sides.T), shape=(count, count)).tocsr()
    graph = ((graph + graph.T) > 0).astype(np.float64)
    reached = np.zeros(count, bool)
    reached[rim] = True
    for _ in range(_REACH - 1):
        reached |= (graph @ reached) > 0
    free = reached.copy()
    free[rim] = False
    inner = np.flatnonzero(free)
    laplacian: Any = sp.diags_array(np.asarray(graph.sum(axis=1)).ravel()) - graph
    share = splu(laplacian[inner][:, inner].tocsc()).solve(graph[inner][:, rim].toarray())
    waves = np.fft.fft(np.eye(len(rim)), axis=0)
    waves[_WAVES + 1 : len(rim) - _WAVES] = 0
    move = np.fft.ifft(waves, axis=0).real - np.eye(len(rim))
    block = np.concatenate([move, share @ move])
    rows = np.repeat(np.concatenate([rim, inner]), len(rim))
    columns = np.tile(rim, len(block))
    return sp.csr_matrix(identity + sp.coo_matrix((block.ravel(), (rows, columns)), (count, count)))


def _loop(following: dict[int, int]) -> np.ndarray:
    """The vertices of the one closed loop, in order; none if there is another number of loops."""
    if not following:
        return np.zeros(0, int)
    start = min(following)
    rim, vertex = [start], following[start]
    while vertex != start and vertex in following and len(rim) <= len(following):
        rim.append(vertex)
        vertex = following[vertex]
    return np.array(rim if len(rim) == len(following) else [], dtype=int)
