"""A finished face under another light, with the transport renderer."""

from __future__ import annotations

import drjit as dr
import numpy as np

from .._runtime import mitsuba
from ..reconstruction import Reconstruction
from ..scene.arrays import device
from ..scene.cells import grid_cells, refine
from ..scene.light import SphericalGaussians
from ..scene.maps import Maps
from ..scene.mesh import Hits, Mesh, surface
from .bounce import Bounce
from .transport import Directions, Points, shade, visibility

mi = mitsuba()


class Relighter:
    """What stays when only the light changes: geometry, shading points, form factors."""

    def __init__(self, reconstruction: Reconstruction, bounces: int = 3) -> None:
        r = reconstruction
        self.maps = Maps(r.diffuse_albedo, r.specular_albedo, r.roughness, r.perturbation)
        self.mesh = Mesh(r.vertices, r.triangles)
        hits = self.mesh.camera_hits(r.camera)
        inside = np.flatnonzero(r.mask.ravel()[hits.pixel.numpy()] > 0).astype(np.uint32)
        chosen = device(mi.UInt32, inside)
        hits = Hits(
            dr.gather(mi.UInt32, hits.pixel, chosen), dr.gather(mi.UInt32, hits.triangle, chosen)
        )
        self.pixel = hits.pixel.numpy().astype(np.int64)
        mesh = self.mesh
        position, _, geometric = surface(
            r.camera, hits, mesh.vertices, mesh.normals, mesh.triangles
        )
        self.points = Points(
            position,
            device(mi.Vector3f, r.diffuse_normal.reshape(-1, 3)[self.pixel]),
            device(mi.Vector3f, r.specular_normal.reshape(-1, 3)[self.pixel]),
            geometric,
            device(mi.Float, r.roughness.ravel()[self.pixel]),
        )
        self.bounce = Bounce(mesh, r.camera, hits, r.roughness, bounces)

    def __call__(self, light: np.ndarray | SphericalGaussians) -> np.ndarray:
        """(S, S, 3) linear sRGB under `light`; 0 outside the mask. See Reconstruction.relight.

        The quadrature is refined where the light is small or steep, so shadows of small lights
        are sharp.
        """
        lobes = isinstance(light, SphericalGaussians)
        environment = light.rasterize() if lobes else np.asarray(light)
        cells = refine(grid_cells(), environment)
        radiance = cells.average(environment)
        directions = Directions(cells)
        bits = visibility(self.mesh.scene, self.points, directions)
        e, s = shade(self.points, directions, bits, radiance)
        indirect_e, indirect_s = self.bounce.under(directions).shade(radiance, self.maps)
        count = len(self.pixel)
        total_e = e.numpy().T.reshape(count, -1) + indirect_e
        total_s = s.numpy().T.reshape(count, -1) + indirect_s
        return composed(self.maps, self.pixel, total_e, total_s)


def composed(maps: Maps, pixel: np.ndarray, e: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Image (H, W, 3) of I = rho_d E + rho_s S at the row-major `pixel` (P,), 0 elsewhere.

    e, s: (P, 1) or (P, 3) total shading.
    """
    shape = maps.diffuse_albedo.shape
    image = np.zeros((shape[0] * shape[1], 3), dtype=np.float32)
    image[pixel] = maps.diffuse_albedo.reshape(-1, 3)[pixel] * e
    image[pixel] += maps.specular_albedo.reshape(-1, 1)[pixel] * s
    return image.reshape(shape)
