"""The truth that reconstructions are held against, and the surface that a camera sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ..scene.camera import Camera
from ..scene.mesh import Mesh, surface


@dataclass(frozen=True)
class Truth:
    """What the camera really sees, (H, W[, 3]) float32, 0 where it sees nothing.

    diffuse_albedo: linear sRGB. specular_albedo: factor on the Beckmann lobe. normal: unit, of
    the shaded surface, and position: cm, both in the world frame. seen: bool, pixels that are
    wholly covered.
    """

    diffuse_albedo: np.ndarray
    specular_albedo: np.ndarray
    normal: np.ndarray
    position: np.ndarray
    seen: np.ndarray


class KnownSubject(Protocol):
    """A head whose truth is known, in the frame of the camera before it."""

    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @cached_property
    def truth(self) -> Truth: ...
    @cached_property
    def bodies(self) -> dict[str, Any]:
        """Its objects in a Mitsuba scene, by name."""
        ...

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3), cm, and triangles (F, 3)."""
        ...

    def photograph(self, environment: np.ndarray, samples: int = 256, seed: int = 0) -> np.ndarray:
        """Path-traced image (H, W, 3), linear, with three inter-reflections."""
        ...


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
