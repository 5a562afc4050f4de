"""Consistency without truth: one person under several lights has one albedo.

Every reconstruction has the mesh of the same head model, so that a point of a triangle is the
same place of the face in all of them. Albedos, and the photos themselves, are compared at the
points that all photos show, pair by pair, after one gain per channel.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from scipy import ndimage

from ..color import encode_srgb
from ..errors import FaceError
from ..face.reconstruction import Reconstruction
from .truth import visible_surface

#: Barycentric coordinates of the points taken on every triangle.
_POINTS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6
#: A point is hidden where the camera sees something nearer by this much, cm.
_HIDDEN = 0.3
_FEWEST = 200


def consistency(faces: list[Reconstruction]) -> dict[str, Any]:
    """PSNR, dB, of albedos and of photos for each pair of `faces`, and their means.

    Raises FaceError if the meshes differ, or fewer than 200 points are seen in all photos.
    """
    triangles = faces[0].face.mesh.triangles
    if any(not np.array_equal(face.face.mesh.triangles, triangles) for face in faces[1:]):
        raise FaceError("the results have different head models; reconstruct them with one")
    seen = np.ones(len(triangles) * len(_POINTS), dtype=bool)
    albedos, photos, areas = [], [], []
    for face in faces:
        xy, area, visible = _points(face)
        seen &= visible
        areas.append(area)
        albedos.append(_sampled(face.face.maps.diffuse_albedo, xy))
        photos.append(_sampled(face.photo.image, xy))
    if seen.sum() < _FEWEST:
        raise FaceError("the photos have too little of the face in common; use nearer views")
    weight = np.mean(areas, axis=0)[seen]
    pairs = [
        {
            "photos": [faces[i].photo.name, faces[j].photo.name],
            "albedo_psnr": _alike(albedos[i][seen], albedos[j][seen], weight),
            "photo_psnr": _alike(photos[i][seen], photos[j][seen], weight),
        }
        for i, j in combinations(range(len(faces)), 2)
    ]
    means = {
        name: float(np.mean([pair[name] for pair in pairs]))
        for name in ("albedo_psnr", "photo_psnr")
    }
    return {"points": int(seen.sum()), "pairs": pairs, **means}


def _points(face: Reconstruction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the points on all triangles: pixels (N, 2), areas of the triangles (N,), whether seen."""
    corners = face.face.mesh.vertices[face.face.mesh.triangles].astype(np.float64)
    points = np.einsum("pk,fkc->fpc", _POINTS, corners).reshape(-1, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.repeat(np.linalg.norm(normal, axis=1), len(_POINTS))
    xy = face.face.camera.project(points)
    nearest = np.clip(np.floor(xy).astype(int), 0, np.array([face.face.camera.width - 1] * 2))
    column, row = nearest.T
    position, _ = visible_surface(
        face.face.mesh.vertices, face.face.mesh.triangles, face.face.camera
    )
    inside = ((xy >= 0) & (xy < face.face.camera.width)).all(axis=1)
    inside &= face.face.mask[row, column] > 0.5
    behind = position[row, column, 2] - points[:, 2]
    return xy, area, inside & (behind < _HIDDEN)


def _sampled(image: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """(N, 3) linear values of `image` at pixels `xy`, interpolated."""
    where = [xy[:, 1] - 0.5, xy[:, 0] - 0.5]
    channels = np.moveaxis(image, -1, 0)
    return np.stack(
        [ndimage.map_coordinates(c, where, order=1, mode="nearest") for c in channels], axis=1
    )


def _alike(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> float:
    """PSNR of encoded values (N, 3), each point by its weight, after one gain per channel.

    Symmetric: both are brought to their common level.
    """
    level_a, level_b = (np.average(x, axis=0, weights=weight) for x in (a, b))
    common = np.sqrt(level_a * level_b)
    x = encode_srgb(a * (common / np.maximum(level_a, 1e-9)))
    y = encode_srgb(b * (common / np.maximum(level_b, 1e-9)))
    error = np.average(np.square(np.clip(x, 0, 1) - np.clip(y, 0, 1)).mean(axis=1), weights=weight)
    return float(-10 * np.log10(max(error, 1e-12)))
