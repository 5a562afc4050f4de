"""The head's outline in the photo pulls the mesh's.

Landmarks end at the face's oval. Where skin ends against the background (of face, ears, neck or a
bald scalp; not where hair, a beard or a hand hides the head's own outline, nor against cloth or the
photo's edge) the photo shows how wide the head is. Points along the mesh's outline look across it
for that border; what they miss by is a residual of the fit, across the outline. An outline slides
over the surface as the head moves, which changes its place in the second order only, so the point
of the surface stands for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ..head.basis import on_rim
from ..head.model import HeadModel
from ..machine.runtime import mitsuba
from ..perception.parser import CLASSES
from ..perception.regions import Regions
from ..scene.arrays import device
from ..scene.camera import Camera
from ..scene.mesh import Mesh
from ..settings.fit import OutlineFit
from .state import STATED_RESOLUTION, State, camera_motion, carried

mi = mitsuba()

_SIZE = 256  # pixels a side of what the outlines are compared in
_SPACING = 6.5  # of the points along the mesh's outline, pixels of 512
_STEP = 0.5  # of the search across it, pixels
_BLUR = 3.0  # of the mesh's outline, for the direction across it, pixels of 512
_BESIDE = 6.0  # where skin and background have to be sure, to both sides of a border
_SURE_SKIN, _SURE_BACKGROUND, _NO_HAIR = 0.8, 0.6, 0.25


@dataclass(frozen=True)
class Border:
    """N points of the mesh's outline that have found the photo's.

    triangle: (N,), weights: (N, 3), barycentric: the points on the mesh. across: (N, 2) unit, image
    frame, outwards. distance: (N,) pixels, from the mesh's outline outwards to the photo's. lost:
    number of further points in plain skin or plain background that have no border in reach.
    """

    triangle: np.ndarray
    weights: np.ndarray
    across: np.ndarray
    distance: np.ndarray
    lost: int


class Outline:
    """Of one photo: where its skin ends against the background, and what that says of a head.

    regions: of the photo, with the parser's shares; camera: of the photo.
    """

    def __init__(
        self, model: HeadModel, camera: Camera, regions: Regions, settings: OutlineFit
    ) -> None:
        assert regions.shares is not None
        size, scale = _SIZE, _SIZE / camera.height
        self.camera = Camera(size, size, camera.focal * scale, camera.cx * scale, camera.cy * scale)
        self.model, self.settings = model, settings
        self.pixel = size / STATED_RESOLUTION
        self.face = cv2.resize(regions.face, (size, size), interpolation=cv2.INTER_AREA)
        self.background, self.hair = (
            cv2.resize(
                regions.shares[..., [CLASSES.index(name) for name in names]].sum(axis=-1),
                (size, size),
                interpolation=cv2.INTER_LINEAR,
            )
            for names in (["background"], ["hair", "beard", "hand", "frame"])
        )
        self.open = _near_rim(model.triangles, len(model.neutral))
        self.mesh: Mesh | None = None

    def equations(self, state: State) -> tuple[np.ndarray, np.ndarray, float]:
        """Gauss-Newton matrix and gradient in a step's unknowns, and the cost.

        Lost points pull nowhere, but cost what the farthest cost: else a head beside the photo's
        would be the likeliest.
        """
        settings = self.settings
        local = self.model.vertices(state.identity, state.expression)
        found = self.border(state.placed(local))
        corners = self.model.triangles[found.triangle]
        point = np.einsum("nc,ncx->nx", found.weights, local[corners])
        basis = carried(self.model.basis, corners, found.weights)
        moves = camera_motion(self.camera, state.placed(point), state.motion(point, basis))
        rows = np.einsum("ni,nik->nk", found.across, moves)
        error = -found.distance / self.pixel
        rows /= self.pixel
        size = np.maximum(np.abs(error), 1e-9)
        each = _SPACING / settings.independent / settings.deviation**2
        huber = np.minimum(1, settings.huber / size)
        weight = each * huber
        cost = 0.5 * np.sum(weight * (2 - huber) * error**2)
        cost += each * found.lost * settings.huber * (settings.reach - 0.5 * settings.huber)
        return (rows * weight[:, None]).T @ rows, rows.T @ (weight * error), float(cost)

    def border(self, vertices: np.ndarray) -> Border:
        """Which points of the outline of the mesh at `vertices` (V, 3), world, find the photo's."""
        triangle, inner, across = self._mesh_outline(vertices)
        edge = inner + 0.5 + 0.5 * across  # half a pixel out of the centre of the last one covered
        reach = self.settings.reach * self.pixel
        steps = np.arange(-reach, reach + _STEP, _STEP)
        skin = _at(self.face, edge[:, None] + steps[:, None] * across[:, None])
        before, after = skin[:, :-1], skin[:, 1:]
        ends = (before >= 0.5) & (after < 0.5)
        place = steps[:-1] + _STEP * (before - 0.5) / np.maximum(before - after, 1e-6)
        nearest = np.argmin(np.where(ends, np.abs(place), np.inf), axis=1)
        distance = np.take_along_axis(place, nearest[:, None], axis=1)[:, 0]
        border = edge + distance[:, None] * across
        beside = _BESIDE * self.pixel
        inside = ((border > beside) & (border < len(self.face) - beside)).all(axis=1)
        near = ends.any(axis=1)
        found = near & inside
        found &= _at(self.face, border - beside * across) > _SURE_SKIN
        found &= _at(self.background, border + beside * across) > _SURE_BACKGROUND
        found &= _at(self.hair, border + beside / 3 * across) < _NO_HAIR
        plain = (_at(self.face, edge) > _SURE_SKIN) | (
            _at(self.background, edge) > _SURE_BACKGROUND
        )
        weights = self._weights(vertices, inner[found], triangle[found])
        lost = int((plain & ~near).sum())
        return Border(triangle[found], weights, across[found], distance[found], lost)

    def _mesh_outline(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Some pixels along the outline: triangles (N,), columns and rows (N, 2), across (N, 2)."""
        vertices = vertices.astype(np.float32)
        if self.mesh is None:
            self.mesh = Mesh(vertices, self.model.triangles)
        else:
            self.mesh.set_vertices(device(mi.Point3f, vertices))
        size = self.camera.width
        hits = self.mesh.camera_hits(self.camera)
        seen = np.full(size * size, -1)
        seen[hits.pixel.numpy()] = hits.triangle.numpy()
        seen = seen.reshape(size, size)
        covered = (seen >= 0).astype(np.float32)
        rows, columns = _along(covered, _SPACING * self.pixel)
        kept = ~self.open[self.model.triangles[seen[rows, columns]]].any(axis=1)
        kept &= (np.minimum(rows, columns) > 1) & (np.maximum(rows, columns) < size - 2)
        rows, columns = rows[kept], columns[kept]
        across = -np.stack([part[rows, columns] for part in _slope(covered, _BLUR * self.pixel)], 1)
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        return seen[rows, columns], np.stack([columns, rows], axis=1), across

    def _weights(self, vertices: np.ndarray, pixel: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """Barycentric weights (N, 3) of the pixels' centres (N, 2) on the triangles seen there."""
        a, b, c = np.moveaxis(vertices[self.model.triangles[triangle]], 1, 0)
        ray = self.camera.unproject(pixel + 0.5, 1.0)
        volumes = [np.sum(ray * np.cross(*pair), axis=1) for pair in ((b, c), (c, a), (a, b))]
        return np.stack(volumes, axis=1) / np.sum(volumes, axis=0)[:, None]


def _along(covered: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (N,) of pixels at the edge of what is covered, evenly `spacing` apart."""
    contours, _ = cv2.findContours(
        covered.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    chosen: list[np.ndarray] = [np.zeros((0, 2), np.int32)]
    for contour in (c[:, 0] for c in contours):
        length = np.cumsum(np.linalg.norm(np.diff(contour, axis=0, prepend=contour[-1:]), axis=1))
        chosen.append(contour[np.unique(length // spacing, return_index=True)[1]])
    columns, rows = np.concatenate(chosen).T
    return rows, columns


def _slope(image: np.ndarray, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (S, S) of the blurred image, towards the right and down."""
    down, right = np.gradient(cv2.GaussianBlur(image, (0, 0), blur))
    return right, down


def _at(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values (...) of (S, S) at points (..., 2), x and y in pixels, between pixels linear."""
    place = np.moveaxis(points[..., ::-1] - 0.5, -1, 0)
    return ndimage.map_coordinates(image, place, order=1, mode="nearest")


def _near_rim(triangles: np.ndarray, count: int) -> np.ndarray:
    """(count,) bool: vertices at a hole of the mesh, as the neck's end, and their neighbours'."""
    rim = on_rim(triangles, count)
    for _ in range(2):
        rim[triangles[rim[triangles].any(axis=1)]] = True
    return rim
