"""A coarse closed surface of the whole person: what hair and clothes are shaded on.

Where the photo shows the head itself, or what lies closely on it, the surface is the fitted head.
Elsewhere the silhouette is inflated: with u = 0 at its outline and Laplace(u) = -3, sqrt(u) is
about as high as half a figure is wide, as a body of revolution is. Both are joined by the
smoothest offset that is the head's where the head is seen and dies away from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba
from ..photo.crop import Crop
from ..scene.camera import Camera
from ..scene.maps import blur
from ..scene.mesh import Mesh, surface
from .person import Person, around, resampled

mi = mitsuba()

#: Pixels a side of the square that the surface is made on.
GRID = 192
#: cm: how far half a chest is from its outline at most, how far the head's depth reaches into what
#: is beside it, and how thick hair is over the scalp at least.
_CHEST, _REACH, _HAIR = 10.0, 6.0, 1.0
_CURVATURE = 3.0  # between a cylinder's, 2, and a ball's, 4
#: Where the head is seen at a lower cosine, its depth falls off beside what is beside it.
_GRAZING = 0.3
#: Weights of the head's depth where it is seen, and below hair, against the offset's smoothness.
_SEEN, _HIDDEN = 10.0, 0.02


class Lattice:
    """The pixels of a mask (N, N) bool, and quadratic energies of values on them.

    rows, columns: (P,) of its pixels. Neighbours are those beside and below; at the mask's outline
    and at the square's edge values are free.
    """

    def __init__(self, mask: np.ndarray) -> None:
        self.mask = mask
        self.rows, self.columns = np.nonzero(mask)
        number = np.full(mask.shape, -1)
        number[mask] = np.arange(len(self.rows))
        beside = (number[:, :-1].ravel(), number[:, 1:].ravel())
        below = (number[:-1].ravel(), number[1:].ravel())
        a, b = (np.concatenate(pair) for pair in zip(beside, below, strict=True))
        inner = (a >= 0) & (b >= 0)
        a, b = a[inner], b[inner]
        count, ones = len(self.rows), np.ones(len(a))
        each = np.arange(len(a))
        edges = sparse.csr_matrix(
            (
                np.concatenate([ones, -ones]),
                (np.concatenate([each, each]), np.concatenate([a, b])),
            ),
            (len(a), count),
        )
        self.number = number
        self._laplacian = edges.T @ edges

    def smoothest(self, weight: np.ndarray) -> Smoothest:
        """Of the energy sum weight (x - t)^2 + |grad x|^2; weight: (P,) >= 0, somewhere above 0."""
        return Smoothest(self._laplacian, weight)

    def image(self, values: np.ndarray, beyond: float = 0.0) -> np.ndarray:
        """(N, N[, C]) float32 of values (P[, C])."""
        out = np.full((*self.mask.shape, *values.shape[1:]), beyond, np.float32)
        out[self.mask] = values
        return out


class Smoothest:
    """Solves for the values (P[, C]) of least energy; see `Lattice.smoothest`."""

    def __init__(self, laplacian: sparse.csr_matrix, weight: np.ndarray) -> None:
        self._weight = weight
        matrix = (laplacian + sparse.diags(weight)).tocsc()
        self._solve = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def __call__(self, target: np.ndarray) -> np.ndarray:
        """target: (P[, C]), what the weights pull to."""
        weight = self._weight.reshape(-1, *([1] * (target.ndim - 1)))
        return self._solve.solve(weight * target)

    def source(self, values: np.ndarray) -> np.ndarray:
        """The same with a force `values` (P,) in place of a target."""
        return self._solve.solve(values)


@dataclass(frozen=True)
class Body:
    """The surface, seen by `camera` at the pixels of the square `canvas`, GRID a side.

    lattice: of the person's pixels, P of them. vertices: (2P, 3) float32, world frame, cm, the P
    seen ones first, then those of the back; triangles: (F, 3), counter-clockwise from outside.
    close, hair: (P,) in [0, 1], how far the surface is the head's own, and how far it is hair.
    pixels_per_cm: of the canvas, at the head.
    """

    canvas: Crop
    camera: Camera
    lattice: Lattice
    vertices: np.ndarray
    triangles: np.ndarray
    close: np.ndarray
    hair: np.ndarray
    pixels_per_cm: float


def inflated(reconstruction: Reconstruction, person: Person) -> Body | None:
    """The body of a person; None where hardly anything of one is seen."""
    crop = reconstruction.photo.crop
    canvas = around(crop, person.side, GRID)
    camera = _camera(reconstruction.face.camera, crop, canvas)
    lattice = Lattice(canvas.image(person.alpha) > 0.5)
    if len(lattice.rows) < GRID:
        return None
    mesh = reconstruction.face.mesh
    hit, head, facing = _head_depth(Mesh(mesh.vertices, mesh.triangles), camera)
    inner: Any = ndimage.binary_erosion(hit)
    rim = hit & ~inner
    base = float(np.median(head[rim])) if rim.any() else float(np.median(-mesh.vertices[:, 2]))
    scale = camera.focal / base
    height = _inflation(lattice) / scale
    height = _CHEST * height / np.hypot(_CHEST, height)

    inside = lattice.mask
    close = np.clip(2 * resampled(person.head, person.square, canvas)[inside] - 1, 0, 1)
    seen, depth, frank = hit[inside], head[inside], facing[inside]
    close = close * np.clip((frank - _GRAZING) / _GRAZING, 0, 1)
    weight = np.where(seen, _HIDDEN * (frank > _GRAZING) + _SEEN * close, 0)
    loose = 1 / (_REACH * scale) ** 2
    wanted = np.where(seen, depth - _HAIR * (close == 0) - (base - height), 0)
    offset = lattice.smoothest(weight + loose)(wanted * weight / (weight + loose))
    front = base - height + offset
    front = np.where(seen & (close == 0), np.minimum(front, depth - 0.2 * _HAIR), front)
    front = _softened(lattice, front)
    back = np.maximum(base + height + offset, front)
    place = np.stack([lattice.columns + 0.5, lattice.rows + 0.5], axis=1)
    vertices = np.concatenate([camera.unproject(place, front), camera.unproject(place, back)])
    hair = resampled(person.hair, person.square, canvas)[inside]
    return Body(
        canvas,
        camera,
        lattice,
        vertices.astype(np.float32),
        _triangles(lattice),
        close,
        hair,
        float(scale),
    )


def _camera(camera: Camera, crop: Crop, canvas: Crop) -> Camera:
    """The crop's camera at the pixels of the canvas."""
    scale = canvas.scale / crop.scale
    cx, cy = canvas.points(crop.inverse_points(np.array([camera.cx, camera.cy])))
    return Camera(GRID, GRID, camera.focal * scale, float(cx), float(cy))


def _head_depth(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, N) each: bool, where the head is; its depth, cm; the cosine at which it is seen."""
    hits = mesh.camera_hits(camera)
    seen = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    position, normal = (x.numpy().T for x in seen[:2])
    images = np.zeros((2, camera.width * camera.height))
    images[0, hits.pixel.numpy()] = -position[:, 2]
    towards = -position / np.linalg.norm(position, axis=1, keepdims=True)
    images[1, hits.pixel.numpy()] = (towards * normal).sum(axis=1)
    depth, facing = images.reshape(2, camera.height, camera.width)
    return depth > 0, depth, facing


def _inflation(lattice: Lattice) -> np.ndarray:
    """(P,): the height in pixels of the inflated silhouette."""
    mask = lattice.mask
    padded = np.pad(mask, 1, mode="edge")  # the figure goes on beyond the square
    outside = sum(
        (~padded[1 + y : 1 + y + len(mask), 1 + x : 1 + x + len(mask)]).astype(float)
        for y, x in ((0, 1), (1, 0), (0, -1), (-1, 0))
    )
    rim = np.asarray(outside)[mask] + 1e-9
    return np.sqrt(np.maximum(lattice.smoothest(rim).source(np.full(len(rim), _CURVATURE)), 0))


def _softened(lattice: Lattice, depth: np.ndarray) -> np.ndarray:
    """(P,): means over neighbours on the person."""
    amount = blur(lattice.mask.astype(np.float32), 1.0)
    return (blur(lattice.image(depth), 1.0) / np.maximum(amount, 1e-6))[lattice.mask]


def _triangles(lattice: Lattice) -> np.ndarray:
    """(F, 3) of the front, and of the back turned round."""
    n = lattice.number
    a, b, c, d = (x.ravel() for x in (n[:-1, :-1], n[1:, :-1], n[:-1, 1:], n[1:, 1:]))
    both = [np.stack(t, axis=1) for t in ((a, b, c), (b, d, c))]
    front = np.concatenate(both)
    front = front[(front >= 0).all(axis=1)]
    return np.concatenate([front, front[:, ::-1] + len(lattice.rows)])
