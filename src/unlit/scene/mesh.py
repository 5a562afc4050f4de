"""The face's geometry as the renderers see it: a posed triangle mesh and its G-buffer.

The mesh lives in the world frame (camera frame, centimetres) and shades with smooth vertex
normals: the sum of the adjacent triangles' normals weighted by area.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from .arrays import at_least, device, where
from .camera import Camera
from .gather import Corners

mi = mitsuba()


def vertex_normals(vertices: Any, corners: Corners) -> Any:
    """Unit vertex normals, differentiable: area-weighted mean of the triangles around each vertex.

    vertices: mi.Point3f of width V; corners: of the F triangles. Returns mi.Vector3f, width V.
    """
    ((a, b, c),) = corners(vertices)
    total = corners.total(mi.Vector3f(dr.cross(b - a, c - a)))
    # A vertex without triangles has no normal; it must not become NaN in the gradient either.
    return total * dr.rsqrt(at_least(dr.squared_norm(total), 1e-20))


@dataclass(frozen=True)
class CameraHits:
    """What P camera rays hit: pixel (P,) row-major index, triangle (P,) index; Dr.Jit UInt32."""

    pixel: Any
    triangle: Any


class Mesh:
    """A triangle mesh in a Mitsuba scene of its own, built once and moved by `set_vertices`.

    vertices: (V, 3) float32, world frame, cm. triangles: (F, 3), counter-clockwise from outside.
    As attributes: vertices mi.Point3f and normals mi.Vector3f, unit, of width V; triangles
    mi.Vector3u of width F; corners: of all triangles; scene: Mitsuba's, with the mesh alone in it.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self.triangles = device(mi.Vector3u, triangles)
        self.corners = Corners(triangles, len(vertices))
        self.vertices = mi.Point3f()
        self.normals = mi.Vector3f()
        self._mesh = mi.Mesh("face", len(vertices), len(triangles), has_vertex_normals=True)
        self._parameters = mi.traverse(self._mesh)
        self._parameters["faces"] = dr.ravel(self.triangles)
        self._parameters.update()
        self.scene: Any = None
        self.set_vertices(device(mi.Point3f, vertices))

    def set_vertices(self, vertices: Any) -> None:
        """Move the mesh to `vertices` (mi.Point3f, width V), and the scene of its rays."""
        self.vertices = dr.detach(vertices)
        self.normals = vertex_normals(self.vertices, self.corners)
        dr.eval(self.vertices, self.normals)
        self._parameters["vertex_positions"] = dr.ravel(self.vertices)
        self._parameters["vertex_normals"] = dr.ravel(self.normals)
        self._parameters.update()
        if self.scene is None:
            self.scene = mi.load_dict({"type": "scene", "face": self._mesh})
            self._scene_parameters = mi.traverse(self.scene)
        else:
            self._scene_parameters["face.vertex_positions"] = dr.ravel(self.vertices)
            self._scene_parameters["face.vertex_normals"] = dr.ravel(self.normals)
            self._scene_parameters.update()

    def hit_corners(self, hits: CameraHits) -> Corners:
        """The corners of the triangles that were hit."""
        triangles = self.triangles.numpy().T[hits.triangle.numpy()]
        return Corners(triangles, dr.width(self.vertices))

    def camera_hits(self, camera: Camera) -> CameraHits:
        """The triangle seen through each pixel centre of `camera`, for the pixels that see one."""
        ray = camera_rays(camera, dr.arange(mi.UInt32, camera.width * camera.height))
        hit = self.scene.ray_intersect_preliminary(ray, coherent=True)
        dr.eval(hit)  # else the rays are traced twice, for the pixels and for their triangles
        pixel = where(hit.is_valid())
        triangle = dr.gather(mi.UInt32, hit.prim_index, pixel)
        dr.eval(pixel, triangle)
        return CameraHits(pixel, triangle)


def camera_rays(camera: Camera, pixel: Any) -> Any:
    """Rays (mi.Ray3f) from the camera through the centres of row-major `pixel` indices."""
    x = mi.Float(pixel % camera.width) + 0.5
    y = mi.Float(pixel // camera.width) + 0.5
    # Opaque: a number baked into the kernel would have it compiled anew for every photo.
    focal, cx, cy = (dr.opaque(mi.Float, v) for v in (camera.focal, camera.cx, camera.cy))
    direction = mi.Vector3f((x - cx) / focal, (cy - y) / focal, -1.0)
    return mi.Ray3f(mi.Point3f(0.0), dr.normalize(direction))


def barycentric(direction: Any, a: Any, b: Any, c: Any) -> Any:
    """Barycentric coordinates (mi.Vector3f, sum 1) of the camera ray's hit on triangle (a, b, c).

    The ray starts at the origin along `direction`. Differentiable in the corners; extrapolates
    when the ray leaves the triangle, so that a normal stays smooth until the next re-tracing.
    """
    weights = mi.Vector3f(
        dr.dot(direction, dr.cross(b, c)),
        dr.dot(direction, dr.cross(c, a)),
        dr.dot(direction, dr.cross(a, b)),
    )
    return weights / dr.sum(weights)


def surface_weights(
    camera: Camera, hits: CameraHits, vertices: Any, triangles: Any
) -> tuple[Any, Any]:
    """The hit triangles' corner indices (mi.Vector3u) and the hits' barycentric weights."""
    corner = dr.gather(mi.Vector3u, triangles, hits.triangle)
    a, b, c = (dr.gather(mi.Point3f, vertices, corner[i]) for i in range(3))
    return corner, barycentric(camera_rays(camera, hits.pixel).d, a, b, c)


def surface(
    camera: Camera,
    hits: CameraHits,
    vertices: Any,
    normals: Any,
    triangles: Any,
    corners: Corners | None = None,
) -> tuple[Any, Any, Any]:
    """Position, unit smooth normal and geometric normal at the camera hits, all differentiable.

    Returns (mi.Point3f, mi.Vector3f, mi.Vector3f) of width P, world frame, cm. corners: those of
    the hit triangles, if gradients are to be the same in every run (Mesh.hit_corners).
    """
    if corners is None:
        corner = dr.gather(mi.Vector3u, triangles, hits.triangle)
        a, b, c = (dr.gather(mi.Point3f, vertices, corner[i]) for i in range(3))
        na, nb, nc = (dr.gather(mi.Vector3f, normals, corner[i]) for i in range(3))
    else:
        (a, b, c), (na, nb, nc) = corners(vertices, normals)
    weights = barycentric(camera_rays(camera, hits.pixel).d, a, b, c)
    position = a * weights.x + b * weights.y + c * weights.z
    normal = na * weights.x + nb * weights.y + nc * weights.z
    return position, dr.normalize(normal), dr.normalize(mi.Vector3f(dr.cross(b - a, c - a)))
