"""Inter-reflection: light that reaches the face by way of the face.

The rays that self-shadowing blocks end on other parts of the face. What leaves there towards the
ray is rho_d E + rho_s S of the light, S being the specular lobe towards the ray, and of the light
that has bounced already (rho_d + rho_s R) E_i, with R the reflectance of the lobe under a uniform
light: right on average, for light that comes from the face all around. Gathered at the mesh's
vertices this is a sparse linear system, with form factors as in radiosity (Goral et al. 1984),

    E_i = G[rho_d (E + E_i) + rho_s (S + R E_i)],   S_i = H[rho_d (E + E_i) + rho_s (S + R E_i)],

solved by a few substitutions, then interpolated to the pixels: indirect light is smooth. G holds
the cosine-weighted and H the specular-lobe-weighted form factors towards the camera. The lobe S of
every ray, `SpecularTransfer`, costs as much as the rest together, so it may be kept while the light
changes little.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from scipy import sparse

from ..machine.runtime import mitsuba
from ..scene.arrays import device, where
from ..scene.brdf import reflectance_table, specular
from ..scene.camera import Camera
from ..scene.maps import Maps
from ..scene.mesh import CameraHits, Mesh, surface_weights
from .transport import Quadrature, ShadingPoints, lobe_towards, shade, visibility
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
class Paths:
    """The N rays from vertices that end on the face, for the highlights where they end.

    receiver: (N,) vertex the ray starts from; emitter: (N,) vertex nearest to its end. towards:
    mi.Vector3f, unit, from the end back to the receiver; normal: mi.Vector3f, unit, and roughness:
    mi.Float, at the end. to_e, to_s: (N,) shares of the outgoing radiance in the receiver's E, S.
    """

    receiver: np.ndarray
    emitter: np.ndarray
    towards: Any
    normal: Any
    roughness: Any
    to_e: np.ndarray
    to_s: np.ndarray


@dataclass(frozen=True)
class FormFactors:
    """Sparse form factors (V, 2V) from the vertices' outgoing radiance to E and S at V vertices.

    The first V columns take the diffuse part rho_d E, the others the specular part rho_s E, whose
    factors include the reflectance R towards the receiver. paths: None on a convex mesh.
    """

    diffuse: sparse.csr_matrix
    specular: sparse.csr_matrix
    paths: Paths | None


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


def form_factors(mesh: Mesh, points: ShadingPoints, seen: np.ndarray, count: int) -> FormFactors:
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
    kept = where(hit.is_valid())
    if not dr.width(kept):  # a convex mesh
        empty = sparse.csr_matrix((vertices, 2 * vertices), dtype=np.float32)
        return FormFactors(empty, empty, None)
    triangle = dr.gather(mi.UInt32, hit.prim_index, kept)
    uv = dr.gather(mi.Point2f, hit.prim_uv, kept)
    point = dr.gather(mi.UInt32, receiver, kept)
    n, towards = dr.gather(mi.Vector3f, n, kept), dr.gather(mi.Vector3f, towards, kept)
    corner = dr.gather(mi.Vector3u, mesh.triangles, triangle)
    shares = (1 - uv.x - uv.y, uv.x, uv.y)
    normal = sum(dr.gather(mi.Vector3f, mesh.normals, corner[i]) * shares[i] for i in range(3))
    normal = dr.normalize(normal)
    leaving = -dr.dot(normal, towards)
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

    largest = np.argmax([share.numpy() for share in shares], axis=0)
    nearest = corner.numpy()[largest, np.arange(len(largest))]
    away = -towards
    dr.eval(away, normal, hit_alpha)
    paths = Paths(point.numpy(), nearest, away, normal, hit_alpha, to_e.numpy(), to_s.numpy())
    return FormFactors(matrix(to_e), matrix(to_s), paths)


@dataclass(frozen=True)
class SpecularTransfer:
    """What the rays bring of the highlights that one light makes on the face.

    to_e, to_s: sparse (V, V), one for each channel of the light: from the vertices' specular
    albedo to E and S at the vertices; none where no ray ends on the face. flux: (D,) or (D, 3),
    radiance times solid angle of the light it holds for.
    """

    to_e: list[sparse.csr_matrix]
    to_s: list[sparse.csr_matrix]
    flux: np.ndarray

    def change(self, flux: np.ndarray) -> float:
        """Share of the light, 0 to 1, that comes from elsewhere in `flux` of the same cells."""
        before, now = (f / max(float(f.sum()), 1e-20) for f in (self.flux, flux))
        return float(np.abs(now - before).sum() / 2)

    def under(self, flux: np.ndarray, rho_s: np.ndarray) -> tuple[Any, Any]:
        """Its share (V, 1) or (V, 3) of E and S, or 0, as of a light as strong as `flux`.

        rho_s: (V, 1) specular albedo of the vertices.
        """
        if not self.to_e:
            return 0.0, 0.0
        gain = float(flux.sum()) / max(float(self.flux.sum()), 1e-20)
        e, s = (np.hstack([m @ rho_s for m in lobe]) for lobe in (self.to_e, self.to_s))
        return gain * e, gain * s


class Interreflection:
    """Indirect shading of the pixels that `hits` see, for one position of `mesh`.

    roughness: (H, W) map, Beckmann alpha. bounces: substitutions, each one more inter-reflection;
    0 leaves indirect light out. rays: of each vertex. emitting: (N,) indices of the vertices that
    send light to those that the camera sees, emitters: these as shading points. world: (V, 3)
    vertices, cm. to_pixels: sparse (P, V), interpolation at the hits.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        hits: CameraHits,
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
        self.points = ShadingPoints(mi.Point3f(mesh.vertices), normal, normal, normal, alpha)
        every = mesh.camera_hits(camera)
        seen = np.unique(mesh.triangles.numpy().T[every.triangle.numpy()])
        self.form_factors = form_factors(mesh, self.points, seen, rays)
        emitting = np.union1d(seen, self.form_factors.diffuse.indices % len(self.world))
        # Neighbours in the image next to each other: rays in packets that stay together.
        order = np.lexsort(np.round(camera.project(self.world[emitting]) / 8).T)
        self.emitting = emitting[order]
        self.emitters = self.points.gather(device(mi.UInt32, self.emitting))
        corner, weight = surface_weights(camera, hits, mesh.vertices, mesh.triangles)
        shape = (self.pixels, len(self.world))
        ends = np.arange(self.pixels + 1) * 3
        self.to_pixels = sparse.csr_matrix(
            (weight.numpy().T.ravel(), corner.numpy().T.ravel(), ends), shape=shape
        )

    def under(self, quadrature: Quadrature) -> IndirectLight:
        """Trace which cells of `quadrature` the vertices see."""
        if not self.bounces:
            return IndirectLight(self, quadrature, None)
        bits = visibility(self.scene, self.emitters, quadrature, self.emitters.horizon)
        return IndirectLight(self, quadrature, bits)


@dataclass(frozen=True)
class IndirectLight:
    """Inter-reflection under a light that is summed over `quadrature`.

    bits: mi.UInt32, visibility of the D cells from the vertices that emit (visibility.trace); None
    without bounces.
    """

    interreflection: Interreflection
    quadrature: Quadrature
    bits: Any

    def specular_transfer(self, radiance: np.ndarray) -> SpecularTransfer:
        """The light's highlights as the face sees them on itself; radiance: (D,) or (D, 3)."""
        reflecting, flux = self.interreflection, self.quadrature.flux(radiance)
        paths = reflecting.form_factors.paths if reflecting.bounces else None
        if paths is None:
            return SpecularTransfer([], [], flux)
        vertices, emitters = len(reflecting.world), reflecting.emitting
        row = np.zeros(vertices, dtype=np.uint32)
        row[emitters] = np.arange(len(emitters))
        lobe = lobe_towards(
            paths.towards,
            paths.normal,
            paths.roughness,
            self.quadrature,
            (self.bits, len(emitters), device(mi.UInt32, row[paths.emitter])),
            radiance,
        )
        channels = lobe.numpy().reshape(-1, len(paths.emitter))
        index, shape = (paths.receiver, paths.emitter), (vertices, vertices)
        e, s = (
            [sparse.csr_matrix((share * channel, index), shape=shape) for channel in channels]
            for share in (paths.to_e, paths.to_s)
        )
        return SpecularTransfer(e, s, flux)

    def shade(
        self, radiance: np.ndarray, maps: Maps, specular: SpecularTransfer | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Indirect E and S, (P, 3) float32 each, to be added to the direct shading.

        radiance: (D,) or (D, 3) cell means. specular: of a light much like it; None makes it anew.
        """
        reflecting = self.interreflection
        if not reflecting.bounces:
            zero = np.zeros((reflecting.pixels, 3), dtype=np.float32)
            return zero, zero
        direct, _ = shade(reflecting.emitters, self.quadrature, self.bits, radiance)
        rows = direct.numpy().T.reshape(len(reflecting.emitting), -1)
        light = np.zeros((len(reflecting.world), rows.shape[1]), dtype=np.float32)
        light[reflecting.emitting] = rows
        rho_d = sample_map(maps.diffuse_albedo, reflecting.camera, reflecting.world)
        rho_s = sample_map(maps.specular_albedo, reflecting.camera, reflecting.world)[:, None]
        specular = specular or self.specular_transfer(radiance)
        specular_e, specular_s = specular.under(self.quadrature.flux(radiance), rho_s)
        indirect = np.zeros_like(rho_d)

        def outgoing() -> np.ndarray:
            return np.concatenate([rho_d * (light + indirect), rho_s * indirect])

        factors = reflecting.form_factors
        for _ in range(reflecting.bounces - 1):
            indirect = factors.diffuse @ outgoing() + specular_e
        e = reflecting.to_pixels @ (factors.diffuse @ outgoing() + specular_e)
        s = reflecting.to_pixels @ (factors.specular @ outgoing() + specular_s)
        return e.astype(np.float32), s.astype(np.float32)
