"""The smooth part of the atlas: a field on the mesh's vertices from the measured ones.

A screened Poisson problem (Bhat et al. 2008): the field f minimises

    sum_i a_i w_i (f_i - d_i)^2 + l^2 sum_ij c_ij (f_i - f_j - g_ij)^2 + sum_i a_i s_i (f_i - m_i)^2

over vertices i of area a and edges ij with cotangent weights c. d is measured, w its evidence, g
the change along an edge that the other half of the face has there, 0 where that is no evidence.
So the field follows what is measured and takes *changes* from the mirror image, so that no seam
can come of it. m is the mirror image's own value, else the part's typical one: where nothing is
known the field goes back to the person's typical skin within some centimetres. It is solved on
the mesh, not in the layout, so that it crosses seams.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

#: l, cm: what is narrower is left to the detail.
_SMOOTH = 0.5
#: Distances, cm, over which an unseen field returns to the typical value, and a mirrored one to
#: the mirror image's: s = (l / this)^2.
_RETURN, _MIRROR = 8.0, 2.0


@dataclass(frozen=True)
class Surface:
    """V vertices, their triangles (F, 3) without what lines the inside, and areas (V,), cm^2."""

    triangles: np.ndarray
    area: np.ndarray
    edges: np.ndarray
    cotangent: np.ndarray

    @staticmethod
    def of(position: np.ndarray, triangles: np.ndarray) -> Surface:
        """position: (V, 3) cm; vertices that no triangle (F, 3) has get no area."""
        corner = position.astype(np.float64)[triangles]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        twice = np.linalg.norm(normal, axis=1)
        area = np.bincount(triangles.ravel(), np.repeat(twice / 6, 3), len(position))
        ends, weights = [], []
        for k in range(3):
            at, a, b = corner[:, k], corner[:, (k + 1) % 3], corner[:, (k + 2) % 3]
            dot = ((a - at) * (b - at)).sum(axis=1)
            weights.append(0.5 * dot / np.maximum(twice, 1e-12))
            ends.append(triangles[:, [(k + 1) % 3, (k + 2) % 3]])
        # Slivers have large and negative cotangents; bounded, the matrix stays well posed.
        cotangent = np.clip(np.concatenate(weights), 0.02, 5)
        return Surface(triangles, area, np.concatenate(ends), cotangent)

    def spread(self, values: np.ndarray, times: int) -> np.ndarray:
        """Values (V,) averaged with those of their neighbours, `times` over."""
        ends = np.concatenate([self.edges, self.edges[:, ::-1]])
        count = np.maximum(np.bincount(ends[:, 0], minlength=len(values)), 1)
        for _ in range(times):
            around = np.bincount(ends[:, 0], values[ends[:, 1]], len(values)) / count
            values = 0.5 * (values + around)
        return values


@dataclass(frozen=True)
class BaseTone:
    """field: (V, C). mirrored: (V, C), the field of each vertex's mirror image."""

    field: np.ndarray
    mirrored: np.ndarray


def base_tone(
    surface: Surface,
    values: np.ndarray,
    weight: np.ndarray,
    typical: np.ndarray,
    twin: np.ndarray,
    twin_weight: np.ndarray,
    back_within: float = _RETURN,
) -> BaseTone:
    """Solve for the field.

    values, typical: (V, C). weight: (V,) evidence in [0, 1]. twin: (V,) number of the mirror
    image of each vertex, itself where there is none; twin_weight: (V,) in [0, 1], how far its
    changes are evidence here. back_within: cm, how far from what was seen the field is `typical`
    again.
    """
    count = len(values)
    i, j = surface.edges.T
    incidence = sp.coo_matrix(
        (
            np.r_[np.ones(len(i)), -np.ones(len(i))],
            (np.tile(np.arange(len(i)), 2), np.r_[i, j]),
        ),
        shape=(len(i), count),
    ).tocsr()
    stiff = incidence.T @ sp.diags_array(_SMOOTH**2 * surface.cotangent)
    back = surface.area * (1 - twin_weight) * (_SMOOTH / back_within) ** 2 + 1e-9
    same = surface.area * twin_weight * (_SMOOTH / _MIRROR) ** 2
    held = surface.area * weight
    matrix: Any = stiff @ incidence + sp.diags_array(held + back + same)
    solver = splu(matrix.tocsc())
    right = held[:, None] * values + back[:, None] * typical
    field = solver.solve(right + same[:, None] * typical)
    if twin_weight.any():
        share = np.minimum(twin_weight[i], twin_weight[j])[:, None]
        change = share * (field[twin[i]] - field[twin[j]])
        field = solver.solve(right + same[:, None] * field[twin] + stiff @ change)
    return BaseTone(field.astype(np.float32), field[twin].astype(np.float32))
