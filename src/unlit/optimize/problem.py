"""The observed pixels that the mesh covers, and the geometry behind them."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..color import encode_srgb
from ..face.gain import AlbedoGain
from ..head.skin_regions import SKIN_REGIONS
from ..machine.runtime import mitsuba
from ..perception.regions import REGIONS
from ..progress.callbacks import StageProgress
from ..render.transport import ShadingPoints
from ..scene.arrays import device
from ..scene.maps import Maps, fill
from ..scene.mesh import CameraHits, Mesh, surface, surface_weights
from ..settings.regions import RoughnessByRegion, SpecularByRegion
from ..settings.settings import Settings
from .estimate import Estimate
from .losses import Neighbours, censored
from .observation import Observation

mi = mitsuba()


class Problem:
    """The observation on the P pixels that both the mask and the fitted mesh cover.

    gain: that of albedo, for inter-reflection. report: called with every loss that is read.
    As attributes: hits: what the P pixels see now; pixel: (P,) int64, row-major. target:
    mi.Color3f, the sRGB-encoded photo, censored; weakest: mi.Float, its weakest channel, linear;
    weight: mi.Float >= 0, sum 1; roughness: mi.Float, Beckmann alpha; all of width P. regions:
    (P, 5) float32, sum 1. log_level: mi.Float, ln of the specular albedo that the settings give a
    pixel's region of the skin, over that of other skin.

    Raises ValueError when the mesh and the mask do not overlap, or nothing there has any weight.
    """

    def __init__(
        self, observation: Observation, settings: Settings, gain: AlbedoGain, report: StageProgress
    ) -> None:
        self.observation, self.settings, self.report = observation, settings, report
        self.gain, self.camera = gain, observation.camera
        self.mesh = Mesh(observation.vertices, observation.triangles)
        hits = self.mesh.camera_hits(self.camera)
        seen = hits.pixel.numpy()
        kept = np.flatnonzero(observation.mask.ravel()[seen])
        if not len(kept):
            raise ValueError("the fitted head and the face's mask do not overlap")
        self.hits = CameraHits(
            device(mi.UInt32, seen[kept]),
            dr.gather(mi.UInt32, hits.triangle, device(mi.UInt32, kept)),
        )
        self.pixel = seen[kept].astype(np.int64)
        #: (H, W) bool, where these pixels are.
        self.inside = np.zeros(observation.mask.shape, dtype=bool)
        self.inside.ravel()[self.pixel] = True
        #: Those of them where the head is fitted well; all where the photo does not count there.
        self.fitted = self.inside & observation.fitted
        if not observation.weight[self.fitted].any():
            self.fitted = self.inside
        self.target = censored(self.color(encode_srgb(observation.image)))
        weakest = observation.image.min(axis=2)
        self.weakest = device(mi.Float, self.rows(weakest))
        weight = self.rows(observation.weight).astype(np.float64)
        if not weight.sum() > 0:
            raise ValueError("all of the face that the head covers lies in a shadow")
        self.weight = device(mi.Float, weight / weight.sum())
        self.neighbours = Neighbours.of(self.pixel, self.camera.width, self.camera.height)
        regions = self.rows(observation.regions).astype(np.float64)
        regions /= np.maximum(regions.sum(axis=1, keepdims=True), 1e-6)
        self.regions = regions.astype(np.float32)
        table = [getattr(settings.roughness, name) for name in REGIONS]
        alpha, level = regions @ table, np.zeros(len(regions))
        if observation.skin_regions is not None:
            shares = regions[:, :1] * self._at_pixels(observation.skin_regions)
            alpha += shares @ _by_region(settings.roughness) - regions[:, 0] * table[0]
            level = shares @ np.log(_by_region(settings.specular_level))
        self.roughness, self.log_level = device(mi.Float, alpha), device(mi.Float, level)

    def _at_pixels(self, values: np.ndarray) -> np.ndarray:
        """(P, C) of values (V, C) of the vertices, at least 0, sum 1."""
        mesh = self.mesh
        corner, weight = surface_weights(self.camera, self.hits, mesh.vertices, mesh.triangles)
        shares = np.einsum("pcr,pc->pr", values[corner.numpy().T], weight.numpy().T)
        shares = np.maximum(shares, 0)
        return shares / shares.sum(axis=1, keepdims=True)

    @property
    def fitted_rows(self) -> np.ndarray:
        """(N,) uint32: which of the P pixels are `fitted`."""
        return np.flatnonzero(self.rows(self.fitted)).astype(np.uint32)

    def __len__(self) -> int:
        return len(self.pixel)

    def color(self, image: np.ndarray) -> Any:
        """mi.Color3f of width P from an image (H, W, 3)."""
        return device(mi.Color3f, self.rows(image))

    def image(self, values: Any, background: str = "nearest") -> np.ndarray:
        """(H, W) or (H, W, 3) float32 image of Dr.Jit values of width P; the rest nearest or 0."""
        out = self.image_of(values.numpy().T)
        return out if background == "zero" else fill(out, self.inside)

    def image_of(self, rows: np.ndarray) -> np.ndarray:
        """(H, W) or (H, W, C) float32 image of rows (P,) or (P, C); the rest 0."""
        shape = (self.camera.height, self.camera.width)
        out = np.zeros((shape[0] * shape[1], *rows.shape[1:]), dtype=np.float32)
        out[self.pixel] = rows
        return out.reshape(*shape, *rows.shape[1:])

    def rows(self, image: np.ndarray) -> np.ndarray:
        """Rows (P,) or (P, C) of an image (H, W) or (H, W, C): what `image_of` undoes."""
        return np.asarray(image.reshape(-1, *image.shape[2:])[self.pixel])

    def albedo_gain(self, albedo: np.ndarray) -> float:
        """What makes diffuse albedo (H, W, 3), as the stages hold it, the skin's.

        As it is it gives the picture; inter-reflection needs the true one.
        """
        return self.gain.during_stages(albedo, self.inside)

    def maps(self, estimate: Estimate) -> Maps:
        """The estimate's reflectance as images, unknown pixels filled from the nearest known."""
        return Maps(
            self.image(dr.exp(estimate.log_diffuse)),
            self.image(dr.exp(estimate.log_specular)),
            self.image(self.roughness),
            self.image(estimate.perturbation, "zero"),
        )

    def bent_normals(self, maps: Maps) -> tuple[Any, Any]:
        """The mesh's normals bent by the maps' perturbation, mi.Vector3f: diffuse, specular."""
        mesh_normal = self.points().specular_normal

        def bent(perturbation: np.ndarray) -> Any:
            return dr.normalize(mesh_normal + device(mi.Vector3f, self.rows(perturbation)))

        return bent(maps.diffuse_perturbation()), bent(maps.perturbation)

    def move(self, vertices: Any) -> None:
        """Move the mesh; pixels that no longer hit it keep the triangle they saw last."""
        self.mesh.set_vertices(vertices)
        hits = self.mesh.camera_hits(self.camera)
        triangle = np.full(self.camera.width * self.camera.height, -1, dtype=np.int64)
        triangle[hits.pixel.numpy()] = hits.triangle.numpy()
        now = triangle[self.pixel]
        now = np.where(now < 0, self.hits.triangle.numpy(), now).astype(np.uint32)
        self.hits = CameraHits(self.hits.pixel, device(mi.UInt32, now))

    def place(self, vertices: Any, triangle: np.ndarray) -> None:
        """Put the mesh where `move` left it, when the pixels saw the triangles (P,)."""
        self.mesh.set_vertices(vertices)
        self.hits = CameraHits(self.hits.pixel, device(mi.UInt32, triangle))

    def points(self, diffuse_normal: Any = None, specular_normal: Any = None) -> ShadingPoints:
        """Shading points of the P pixels on the mesh as it is, with other normals if given."""
        mesh = self.mesh
        position, normal, geometric = surface(
            self.camera, self.hits, mesh.vertices, mesh.normals, mesh.triangles
        )
        dr.eval(position, normal, geometric)
        return ShadingPoints(
            position,
            normal if diffuse_normal is None else diffuse_normal,
            normal if specular_normal is None else specular_normal,
            geometric,
            self.roughness,
        )


def _by_region(table: RoughnessByRegion | SpecularByRegion) -> np.ndarray:
    """(8,) what the settings have for SKIN_REGIONS."""
    return np.array([getattr(table, name) for name in SKIN_REGIONS])
