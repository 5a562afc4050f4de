"""One Catmull-Clark step as a sparse matrix, so that one product refines every basis vector.

E. Catmull, J. Clark: Recursively generated B-spline surfaces on arbitrary topological meshes,
Computer-Aided Design 10(6), 1978; boundaries as cubic B-spline curves.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp


def catmull_clark(
    quads: np.ndarray, vertex_count: int, smooth: bool = True
) -> tuple[sp.csr_matrix, np.ndarray]:
    """Split every quad in four.

    quads: (Q, 4) int corner indices, consistently oriented; edges have one or two quads.
    smooth: False places the new points at plain midpoints and leaves the old ones alone, which
        is what texture coordinates need.

    Returns the matrix (N, V), float32, rows summing to 1, that gives the fine vertices, and the
    quads (4 Q, 4) int32 into them: the old vertices, then one per edge, then one per quad.
    """
    corner = quads.astype(np.int64)
    following = np.roll(corner, -1, axis=1)
    low, high = np.minimum(corner, following), np.maximum(corner, following)
    keys, edge_of_side = np.unique(low * vertex_count + high, return_inverse=True)
    edge_of_side = edge_of_side.reshape(corner.shape)
    ends = np.stack([keys // vertex_count, keys % vertex_count], axis=1)
    n_face, n_edge = len(corner), len(ends)

    face_points = _averages(corner, vertex_count)
    edge_middles = _averages(ends, vertex_count)
    sides = np.bincount(edge_of_side.ravel(), minlength=n_edge)
    edge_points = edge_middles
    vertex_points = sp.identity(vertex_count, format="csr")
    if smooth:
        faces_of_edge = sp.csr_matrix(
            (np.ones(corner.size), (edge_of_side.ravel(), np.repeat(np.arange(n_face), 4))),
            shape=(n_edge, n_face),
        )
        inner = (sides == 2).astype(float)
        edge_points = (
            sp.diags_array(1 - inner / 2) @ edge_middles
            + sp.diags_array(inner / 4) @ faces_of_edge @ face_points
        )
        vertex_points = _vertex_rule(corner, ends, sides, vertex_count, face_points, edge_middles)

    edges = vertex_count + edge_of_side
    centre = np.broadcast_to(vertex_count + n_edge + np.arange(n_face)[:, None], corner.shape)
    fine = np.stack([corner, edges, centre, np.roll(edges, 1, axis=1)], axis=-1)
    matrix = sp.vstack([vertex_points, edge_points, face_points]).tocsr().astype(np.float32)
    return sp.csr_matrix(matrix), fine.reshape(-1, 4).astype(np.int32)


def triangulate(quads: np.ndarray) -> np.ndarray:
    """Both triangles of each quad (Q, 4), as (2 Q, 3), cut at the first corner's diagonal."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def _averages(members: np.ndarray, count: int) -> sp.csr_matrix:
    """Matrix (len(members), count) whose rows average the listed vertices."""
    rows = np.repeat(np.arange(len(members)), members.shape[1])
    weights = np.full(members.size, 1.0 / members.shape[1])
    return sp.csr_matrix((weights, (rows, members.ravel())), shape=(len(members), count))


def _vertex_rule(
    corner: np.ndarray,
    ends: np.ndarray,
    sides: np.ndarray,
    count: int,
    face_points: sp.csr_matrix,
    edge_middles: sp.csr_matrix,
) -> sp.csr_matrix:
    """Inner: (F + 2 R + (n - 3) P) / n; on a boundary: (neighbour + 6 P + neighbour) / 8."""

    def incidence(members: np.ndarray) -> sp.csr_matrix:
        columns = np.repeat(np.arange(len(members)), members.shape[1])
        values = np.ones(members.size)
        return sp.csr_matrix((values, (members.ravel(), columns)), shape=(count, len(members)))

    rim = ends[sides == 1]
    on_rim = np.zeros(count, dtype=bool)
    on_rim[rim] = True
    inner = ~on_rim
    valence = np.bincount(ends.ravel(), minlength=count)
    used = np.maximum(valence, 1)
    old = np.where(valence > 0, np.where(inner, (used - 3) / used, 0.5), 1.0)
    share = np.where(inner & (valence > 0), 1.0 / used**2, 0.0)
    return (
        sp.diags_array(old)
        + sp.diags_array(share) @ incidence(corner) @ face_points
        + sp.diags_array(2 * share) @ incidence(ends) @ edge_middles
        + sp.diags_array(np.where(on_rim, 0.25, 0.0)) @ incidence(rim) @ _averages(rim, count)
    ).tocsr()
