"""Inter-reflection: light that reaches the face by way of the face.

The rays that self-shadowing blocks end on other parts of the face, whose outgoing radiance
towards the ray is taken as (rho_d + rho_s R(theta)) E, with R the reflectance of the specular lobe
under a uniform light: diffuse reflection is exact, the lobe is right on average over the light.
(Leaving R out loses a sixth of the indirect light: most of it travels at grazing angles, across
creases.) Gathered at the mesh's vertices this is a sparse linear system, with form factors as in
radiosity (Goral et al. 1984),

    E_i = G[(rho_d + rho_s R)(E + E_i)],        S_i = H[(rho_d + rho_s R)(E + E_i)],

solved by a few substitutions, then interpolated to the pixels: indirect light is smooth. G holds
the cosine-weighted and H the specular-lobe-weighted form factors towards the camera.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from scipy import sparse

from .._runtime import mitsuba
from ..scene.arrays import device
from ..scene.brdf import reflectance_table, specular
from ..scene.camera import Camera
from ..scene.maps import Maps
from ..scene.mesh import Hits, Mesh, surface_weights
from .transport import Directions, Points, shade, visibility
from .visibility import OFFSET

mi = mitsuba()


def sphere_directions(count: int) -> np.ndarray:
    """Nearly even unit directions (count, 3), float32: a spherical Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    phi = k * (np.pi * (1 + np.sqrt(5)))
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1).astype(np.float32)


def sample_map(image: np.ndarray, camera: Camera, points: np.ndarray) -> np.ndarray:
    """Nearest values (N, ...) of a map (H, W, ...) at the pixels that points (N, 3) project to."""
    xy = np.floor(camera.project(points)).astype(np.int64)
    return image[np.clip(xy[:, 1], 0, camera.height - 1), np.clip(xy[:, 0], 0, camera.width - 1)]


@dataclass(frozen=True)
class FormFactors:
    """Sparse form factors (V, 2V) from the vertices' outgoing radiance to E and S at V vertices.

    The first V columns take the diffuse part rho_d E, the others the specular part rho_s E, whose
    factors include the reflectance R towards the receiver.
    """

    diffuse: sparse.csr_matrix
    specular: sparse.csr_matrix


@functools.cache
def _reflectance_texture() -> tuple[Any, float, float, int]:
    alphas = np.linspace(0.05, 0.65, 13)
    cosines = (np.arange(24) + 0.5) / 24
    table = reflectance_table(alphas, cosines)
    texture = mi.Texture2f(
        mi.TensorXf(table[..., None]), filter_mode=dr.FilterMode.Linear, wrap_mode=dr.WrapMode.Clamp
    )
    return texture, alphas[0], alphas[-1], len(alphas)


def _reflectance(cosine: Any, alpha: Any) -> Any:
    """The lobe's reflectance (mi.Float), interpolated in a table over roughness and cosine."""
    texture, first, last, count = _reflectance_texture()
    v = (alpha - first) / (last - first) * (count - 1) + 0.5
    return texture.eval(mi.Point2f(cosine, v / count))[0]


def form_factors(mesh: Mesh, points: Points, seen: np.ndarray, count: int = 256) -> FormFactors:
    """Trace `count` directions from the vertices `seen` and record which triangles they end on.

    points: the mesh's vertices as shading points, width V; seen: indices of those that receive,
    the camera's side of the head (light that bounced twice by way of a hidden part is left out).
    A ray that meets a triangle from behind carries no light.
    """
    vertices, receivers = len(points), len(seen)
    lattice = sphere_directions(count)
    directions = device(mi.Vector3f, lattice)
    index = dr.arange(mi.UInt32, receivers * count)
    width = dr.opaque(mi.UInt32, receivers)
    receiver = dr.gather(mi.UInt32, device(mi.UInt32, seen), index % width)
    n = dr.gather(mi.Vector3f, points.diffuse_normal, receiver)
    towards = dr.gather(mi.Vector3f, directions, index // width)
    start = dr.gather(mi.Point3f, points.position, receiver) + OFFSET * n
    hit = mesh.scene.ray_intersect_preliminary(
        mi.Ray3f(start, towards), coherent=True, active=dr.dot(n, towards) > 0
    )
    dr.eval(hit)  # else each of its parts that is gathered below would have all rays traced again
    kept = dr.compress(hit.is_valid())
    if not dr.width(kept):  # a convex mesh
        empty = sparse.csr_matrix((vertices, 2 * vertices), dtype=np.float32)
        return FormFactors(empty, empty)
    triangle = dr.gather(mi.UInt32, hit.prim_index, kept)
    uv = dr.gather(mi.Point2f, hit.prim_uv, kept)
    point = dr.gather(mi.UInt32, receiver, kept)
    n, towards = dr.gather(mi.Vector3f, n, kept), dr.gather(mi.Vector3f, towards, kept)
    corner = dr.gather(mi.Vector3u, mesh.triangles, triangle)
    shares = (1 - uv.x - uv.y, uv.x, uv.y)
    normal = sum(dr.gather(mi.Vector3f, mesh.normals, corner[i]) * shares[i] for i in range(3))
    leaving = -dr.dot(dr.normalize(normal), towards)
    alpha = dr.gather(mi.Float, points.roughness, point)
    viewer = dr.gather(mi.Vector3f, points.to_viewer, point)
    solid_angle = dr.select(leaving > 0, 4 * np.pi / count, 0)
    to_e = dr.dot(n, towards) / dr.pi * solid_angle
    to_s = specular(n, towards, viewer, alpha) * solid_angle
    hit_alpha = dr.gather(mi.Float, points.roughness, corner[0])
    shine = _reflectance(leaving, hit_alpha)

    row = np.tile(point.numpy(), 6)
    columns = np.concatenate([corner[i].numpy() for i in range(3)])
    columns = np.concatenate([columns, columns + vertices])

    def matrix(weight: Any) -> sparse.csr_matrix:
        parts = [(weight * share).numpy() for share in shares]
        parts += [(weight * share * shine).numpy() for share in shares]
        shape = (vertices, 2 * vertices)
        return sparse.csr_matrix((np.concatenate(parts), (row, columns)), shape=shape)

    return FormFactors(matrix(to_e), matrix(to_s))


class Bounce:
    """Indirect shading of the pixels that `hits` see, for one position of `mesh`.

    roughness: (H, W) map. bounces: substitutions; each adds one more inter-reflection, 0 leaves
    indirect light out. rays: of each vertex.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        hits: Hits,
        roughness: np.ndarray,
        bounces: int = 3,
        rays: int = 256,
    ) -> None:
        self.scene, self.camera, self.bounces = mesh.scene, camera, bounces
        self.pixels = dr.width(hits.pixel)
        if not bounces:
            return
        self.world = mesh.vertices.numpy().T
        normal = mi.Vector3f(mesh.normals)
        alpha = device(mi.Float, sample_map(roughness, camera, self.world))
        self.points = Points(mi.Point3f(mesh.vertices), normal, normal, normal, alpha)
        every = mesh.camera_hits(camera)
        seen = np.unique(mesh.triangles.numpy().T[every.triangle.numpy()])
        self.factors = form_factors(mesh, self.points, seen, rays)
        lit = np.union1d(seen, self.factors.diffuse.indices % len(self.world))
        # Neighbours in the image next to each other: rays in packets that stay together.
        order = np.lexsort(np.round(camera.project(self.world[lit]) / 8).T)
        self.lit = lit[order]
        self.emitters = self.points.gather(device(mi.UInt32, self.lit))
        corner, weight = surface_weights(camera, hits, mesh.vertices, mesh.triangles)
        shape = (self.pixels, len(self.world))
        ends = np.arange(self.pixels + 1) * 3
        self.to_pixels = sparse.csr_matrix(
            (weight.numpy().T.ravel(), corner.numpy().T.ravel(), ends), shape=shape
        )

    def under(self, directions: Directions) -> BounceUnder:
        """The same, with the vertices' visibility traced for the cells of `directions`."""
        if not self.bounces:
            return BounceUnder(self, directions, None)
        bits = visibility(self.scene, self.emitters, directions, self.emitters.horizon)
        return BounceUnder(self, directions, bits)


@dataclass(frozen=True)
class BounceUnder:
    """A Bounce and the quadrature its direct light is summed with."""

    bounce: Bounce
    directions: Directions
    bits: Any

    def shade(self, radiance: np.ndarray, maps: Maps) -> tuple[np.ndarray, np.ndarray]:
        """Indirect E and S, (P, 3) float32 each, to be added to the direct shading.

        radiance: (D,) or (D, 3) cell means.
        """
        bounce = self.bounce
        if not bounce.bounces:
            zero = np.zeros((bounce.pixels, 3), dtype=np.float32)
            return zero, zero
        direct, _ = shade(bounce.emitters, self.directions, self.bits, radiance)
        rows = direct.numpy().T.reshape(len(bounce.lit), -1)
        light = np.zeros((len(bounce.world), rows.shape[1]), dtype=np.float32)
        light[bounce.lit] = rows
        rho_d = sample_map(maps.diffuse_albedo, bounce.camera, bounce.world)
        rho_s = sample_map(maps.specular_albedo, bounce.camera, bounce.world)[:, None]
        indirect = np.zeros_like(rho_d)

        def outgoing() -> np.ndarray:
            total = light + indirect
            return np.concatenate([rho_d * total, np.broadcast_to(rho_s * total, rho_d.shape)])

        factors = bounce.factors
        for _ in range(bounce.bounces - 1):
            indirect = factors.diffuse @ outgoing()
        e, s = (bounce.to_pixels @ (m @ outgoing()) for m in (factors.diffuse, factors.specular))
        return e.astype(np.float32), s.astype(np.float32)
