"""Synthetic subjects: heads of known shape and reflectance, photographed by path tracing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..machine.runtime import mitsuba
from ..render.reference import path_trace
from ..scene.camera import Camera
from ..scene.maps import Maps
from ..scene.mesh import Mesh, surface
from .truth import Truth

mi = mitsuba()


@dataclass(frozen=True)
class Subject:
    """A head with known truth, seen by a camera.

    vertices (V, 3) world, cm; triangles (F, 3). maps: true reflectance in the camera's pixels.
    mask: (H, W) bool, face pixels on which results are compared.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    camera: Camera
    maps: Maps
    mask: np.ndarray

    def photograph(self, environment: np.ndarray, samples: int = 256, seed: int = 0) -> np.ndarray:
        """Path-traced image (H, W, 3), linear, with three inter-reflections of the face."""
        mesh = Mesh(self.vertices, self.triangles)
        return path_trace(
            mesh, self.camera, self.maps, environment, samples=samples, bounces=3, seed=seed
        )

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and triangles."""
        return self.vertices, self.triangles

    @cached_property
    def truth(self) -> Truth:
        """What the camera sees; `seen` is the face's mask."""
        position, normal = visible_surface(self.vertices, self.triangles, self.camera)
        bent = normal + self.maps.perturbation * (normal != 0).any(axis=-1, keepdims=True)
        bent /= np.maximum(np.linalg.norm(bent, axis=-1, keepdims=True), 1e-6)
        return Truth(self.maps.diffuse_albedo, self.maps.specular_albedo, bent, position, self.mask)


def visible_surface(
    vertices: np.ndarray, triangles: np.ndarray, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Position, cm, and smooth normal, (H, W, 3) each, that the camera sees; 0 beside the mesh."""
    mesh = Mesh(vertices, triangles)
    hits = mesh.camera_hits(camera)
    seen = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)[:2]
    images = []
    for values in seen:
        image = np.zeros((camera.height * camera.width, 3), dtype=np.float32)
        image[hits.pixel.numpy()] = values.numpy().T
        images.append(image.reshape(camera.height, camera.width, 3))
    return images[0], images[1]
