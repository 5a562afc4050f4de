"""Lips and lids drawn to where the photo has them, beyond what the model's axes can do.

What the fit leaves of the landmarks' distances is taken up by a smooth displacement of the surface
in the image plane: a Gaussian field on the mesh whose covariance is Matérn's, as the solution of

    tau (kappa^2 - Laplacian) u = white noise

(Lindgren, Rue and Lindström 2011), so that neighbours move together along the surface, but the two
lips and the two lids, close in space and far apart along it, apart. Its posterior mean under the
landmarks, each with its error along and across its contour, is linear algebra with one sparse
factorisation. Landmarks in the dark are trusted less, as in the fit, and none is followed farther
than three deviations of the field: what lies beyond is no lip but a hand before it.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..head.basis import vertex_areas
from ..head.model import HeadModel
from ..perception.measures import tangents
from ..perception.topology import LEFT_EYE, LIPS_INNER, LIPS_OUTER, RIGHT_EYE
from ..scene.camera import Camera
from ..settings.fit import Registration
from .state import STATED_RESOLUTION, State

_CONTOURS = (LIPS_OUTER, LIPS_INNER, RIGHT_EYE, LEFT_EYE)
_FARTHEST = 3.0  # deviations of the field


def registered(
    model: HeadModel,
    camera: Camera,
    state: State,
    shape: np.ndarray,
    landmarks: np.ndarray,
    light: np.ndarray,
    settings: Registration,
) -> np.ndarray:
    """Vertices (V, 3), model frame, of `shape` at `state`, drawn to landmarks (478, 2), pixels.

    light: (478,) in (0, 1], factors on the landmarks' weights.
    """
    index, along = _directions(landmarks)
    carried = model.landmark_points.triangle[index] >= 0
    index, along = index[carried], along[carried]
    if not len(index):
        return shape
    corners = model.triangles[model.landmark_points.triangle[index]]
    weights = model.landmark_points.barycentric[index]
    rows = np.repeat(np.arange(len(index)), 3)
    size = (len(index), len(shape))
    points = sp.csr_matrix((weights.ravel(), (rows, corners.ravel())), size)
    world = state.placed(points @ shape)
    scale = -world[:, 2:] / camera.focal  # cm a pixel
    missed = (landmarks[index] - camera.project(world)) * scale
    length = np.linalg.norm(missed, axis=1, keepdims=True)
    missed *= np.minimum(1, _FARTHEST * settings.deviation / np.maximum(length, 1e-9))
    noise = np.mean(scale) * camera.height / STATED_RESOLUTION
    error = np.einsum("ni,nj->nij", along, along) * (settings.along**2 - settings.across**2)
    error = noise**2 * (error + settings.across**2 * np.eye(2)) * settings.shared
    error /= light[index, None, None]
    spread = field_covariance(model, points.toarray(), settings)
    covariance = np.einsum("nm,ij->nimj", points @ spread, np.eye(2))
    place = np.arange(len(index))
    covariance[place, :, place] += error
    count = 2 * len(index)
    pull = np.linalg.solve(covariance.reshape(count, count), missed.ravel()).reshape(-1, 2)
    moved = np.zeros_like(shape, dtype=np.float64)
    moved[:, :2] = (spread @ pull) * (1, -1)
    return (shape + moved @ state.rotation).astype(np.float32)


def _directions(landmarks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks' numbers (N,) and the unit directions (N, 2) of their contours there."""
    found: dict[int, np.ndarray] = {}
    for contour in _CONTOURS:
        found |= dict(zip(contour, tangents(landmarks[list(contour)]), strict=True))
    return np.array(list(found)), np.array(list(found.values()))


def field_covariance(model: HeadModel, points: np.ndarray, settings: Registration) -> np.ndarray:
    """(V, N): covariance, cm^2, of the field at every vertex with it at points.

    points: (N, V), weights of the vertices that make each of them.
    """
    kappa = np.sqrt(8) / settings.length
    mass = np.maximum(vertex_areas(model.neutral, model.triangles), 1e-6)
    stiffness = _stiffness(model.neutral.astype(np.float64), model.triangles)
    matrix = (kappa**2 * sp.diags(mass) + stiffness).tocsc()
    symmetric = {"SymmetricMode": True}
    solver = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0, options=symmetric)
    half = solver.solve(points.T.astype(np.float64))
    return 4 * np.pi * kappa**2 * settings.deviation**2 * solver.solve(mass[:, None] * half)


def _stiffness(vertices: np.ndarray, triangles: np.ndarray) -> sp.csr_matrix:
    """Stiffness matrix (V, V) of the surface's Laplacian, by cotangents."""
    count = len(vertices)
    rows, columns, values = [], [], []
    for k in range(3):
        i, j, opposite = (triangles[:, (k + s) % 3] for s in range(3))
        a, b = vertices[i] - vertices[opposite], vertices[j] - vertices[opposite]
        sine = np.linalg.norm(np.cross(a, b), axis=1)
        # Obtuse and flat triangles would make it indefinite.
        weight = 0.5 * np.clip(np.sum(a * b, axis=1) / np.maximum(sine, 1e-9), 0.02, 20)
        rows += [i, j, i, j]
        columns += [j, i, i, j]
        values += [-weight, -weight, weight, weight]
    place = (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_matrix((np.concatenate(values), place), (count, count))
