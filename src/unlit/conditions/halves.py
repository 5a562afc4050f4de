"""Which pixels of a photo show points of the face that mirror each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ..optimize.problem import Problem
from ..perception.topology import FACE_OVAL

#: Vertices that the plane is found from, at most; turns; and the distance, cm, at which a vertex
#: without a mirror image counts half.
_VERTICES, _TURNS, _FAR = 2000, 30, 0.5


@dataclass(frozen=True)
class Halves:
    """Of the P pixels of a problem.

    twin: (P,) which pixel shows the mirror image, or what is nearest to it; apart: (P,) cm, how
    far from it. beside: (P,) cm, distance from the middle of the face, with a sign. normal: (P, 3)
    of the mesh, world frame.
    """

    twin: np.ndarray
    apart: np.ndarray
    beside: np.ndarray
    normal: np.ndarray

    @staticmethod
    def of(problem: Problem, across: np.ndarray) -> Halves:
        """By the plane about which the problem's mesh is most nearly its own mirror image.

        across: (3,) as for `mirror_plane`.
        """
        points = problem.points()
        position = points.position.numpy().T.astype(np.float64)
        across, offset = mirror_plane(problem.observation.vertices, across)
        beside = position @ across - offset
        apart, twin = KDTree(position).query(position - 2 * beside[:, None] * across)
        return Halves(np.asarray(twin), np.asarray(apart), beside, points.specular_normal.numpy().T)


def across(landmarks: np.ndarray) -> np.ndarray:
    """(3,) unit, world frame, across a face of landmarks (478, 3), pixels, near is small.

    +x where they are all in one place, as stand-ins for landmarks are.
    """
    ring = landmarks[list(FACE_OVAL)]
    # It begins at the hairline, which is its own mirror image.
    found = (ring[1:] - ring[:0:-1])[: len(ring) // 2].mean(axis=0) * (1, -1, -1)
    length = np.linalg.norm(found)
    return np.asarray(found / length if length > 0 else np.array([1.0, 0, 0]))


def mirror_plane(vertices: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, float]:
    """The plane about which vertices (V, 3), cm, of a head are most nearly symmetric.

    across: (3,) its normal, known within some 10 degrees. Returns that normal, unit, and the
    plane's distance from the origin along it. Every vertex is held against the nearest to its
    mirror image, and the plane found again from these pairs.
    """
    vertices = vertices.astype(np.float64)
    some = vertices[:: max(1, len(vertices) // _VERTICES)]
    tree, offset = KDTree(vertices), float(vertices.mean(axis=0) @ across)
    for _ in range(_TURNS):
        far, nearest = tree.query(some - 2 * (some @ across - offset)[:, None] * across)
        other = vertices[nearest]
        weight = 1 / (1 + (far / _FAR) ** 2)
        middle = np.average((some + other) / 2, axis=0, weights=weight)
        # |p - 2 (n . p) n - q|^2 = |p - q|^2 + 4 (n . p) (n . q)
        products = ((some - middle) * weight[:, None]).T @ (other - middle)
        found = np.linalg.eigh(products + products.T)[1][:, 0]
        across = found * (1 if found @ across > 0 else -1)
        offset = float(middle @ across)
    return across, offset
