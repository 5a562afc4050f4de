"""A small head-like mesh for the tests of the renderer: a bumpy ball with a nose and eye sockets.

Made in a few milliseconds, so that no model has to be there; it shadows itself and lights itself
as a face does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from unlit.machine.runtime import mitsuba
from unlit.render.transport import ShadingPoints
from unlit.scene.camera import Camera
from unlit.scene.maps import Maps
from unlit.scene.mesh import CameraHits, Mesh, surface

mi = mitsuba()

DISTANCE = 70.0
RADIUS = 9.0
# World, cm: centre, height and width of the Gaussian bumps; the first is the nose.
_BUMPS = (
    ((0.0, -0.05, 1.0), 2.8, 0.17),
    ((0.36, 0.25, 0.9), -1.8, 0.20),
    ((-0.36, 0.25, 0.9), -1.8, 0.20),
    ((0.0, -0.42, 0.9), -1.4, 0.15),
    ((0.0, -0.75, 0.7), 1.4, 0.20),
    ((0.75, 0.0, 0.65), 0.5, 0.35),
    ((-0.7, -0.3, 0.65), 0.4, 0.30),
)


def ball(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit icosphere: vertices (V, 3) float64 and triangles (F, 3) int32, outward."""
    g = (1 + np.sqrt(5)) / 2
    vertices = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    vertices += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = np.array(vertices)
    triangles = ConvexHull(points).simplices.astype(np.int32)
    a, b, c = points[triangles].swapaxes(0, 1)
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    triangles[inward] = triangles[inward, ::-1]
    for _ in range(subdivisions):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = (len(points) + inverse.reshape(-1, 3)).astype(np.int32)
        points = np.concatenate([points, points[unique].mean(axis=1)])
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        (a, b, c), (ab, bc, ca) = triangles.T, middle.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(p, axis=1) for p in parts])
    return points / np.linalg.norm(points, axis=1, keepdims=True), triangles


def bumpy_head(subdivisions: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float32, world, cm, and triangles (F, 3) int32; 2,562 vertices by default."""
    unit, triangles = ball(subdivisions)
    radius = np.full(len(unit), RADIUS)
    for centre, height, width in _BUMPS:
        direction = np.array(centre) / np.linalg.norm(centre)
        radius += height * np.exp((unit @ direction - 1) / width**2)
    vertices = unit * radius[:, None] * (0.85, 1.1, 1.0) + (0.4, -0.3, -DISTANCE)
    return vertices.astype(np.float32), triangles


def camera(size: int) -> Camera:
    """A camera whose field, 23 cm at the head, holds the head; principal point off centre."""
    return Camera(size, size, size * DISTANCE / 23.0, size / 2 - 1.3, size / 2 + 2.1)


def painted(size: int, seed: int = 3) -> Maps:
    """Smoothly varying maps with a bent normal (size, size), all within their ranges."""
    rng = np.random.default_rng(seed)

    def noise() -> np.ndarray:
        field = ndimage.gaussian_filter(rng.standard_normal((size, size)), size / 16, mode="wrap")
        return (field / field.std()).astype(np.float32)

    albedo = np.stack([0.45 + 0.05 * noise(), 0.3 + 0.04 * noise(), 0.25 + 0.04 * noise()], axis=2)
    bend = 0.05 * np.stack([noise(), noise(), noise()], axis=2)
    return Maps(
        np.clip(albedo, 0.02, 0.9).astype(np.float32),
        (0.9 + 0.1 * noise()).astype(np.float32),
        np.clip(0.3 + 0.03 * noise(), 0.15, 0.5).astype(np.float32),
        bend.astype(np.float32),
    )


@dataclass(frozen=True)
class View:
    """A mesh as `camera` sees it: its hits, and shading points with the bent normals of `maps`."""

    mesh: Mesh
    camera: Camera
    maps: Maps
    hits: CameraHits
    points: ShadingPoints
    pixel: np.ndarray

    def image(self, values: Any) -> np.ndarray:
        """(H, W) or (H, W, 3) image of per-pixel values, 0 elsewhere."""
        rows = values if isinstance(values, np.ndarray) else values.numpy().T
        out = np.zeros((self.camera.height * self.camera.width, *rows.shape[1:]), np.float32)
        out[self.pixel] = rows
        return out.reshape(self.camera.height, self.camera.width, *rows.shape[1:])

    def inside(self, margin: int = 6, facing: float = 0.2) -> np.ndarray:
        """(H, W) bool: `margin` pixels off the silhouette, cosine to the viewer over `facing`."""
        cosine = self.image(dr.dot(self.points.geometric, self.points.to_viewer))
        return ndimage.binary_erosion(cosine > facing, iterations=margin)


def view(vertices: np.ndarray, triangles: np.ndarray, camera: Camera, maps: Maps) -> View:
    """Trace the camera rays and gather the shading points."""
    mesh = Mesh(vertices, triangles)
    hits = mesh.camera_hits(camera)
    pixel = hits.pixel.numpy().astype(np.int64)
    position, normal, geometric = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)

    def bent(image: np.ndarray) -> Any:
        rows = image.reshape(-1, 3)[pixel].T
        return dr.normalize(normal + mi.Vector3f(np.ascontiguousarray(rows)))

    points = ShadingPoints(
        position,
        bent(maps.diffuse_perturbation()),
        bent(maps.perturbation),
        geometric,
        mi.Float(maps.roughness.ravel()[pixel]),
    )
    return View(mesh, camera, maps, hits, points, pixel)


def filtered(image: np.ndarray) -> np.ndarray:
    """5 x 5 box filter of (H, W) or (H, W, 3)."""
    return ndimage.uniform_filter(image, 5, axes=(0, 1))
