"""What the stages share: the photo's evidence, the current estimate, and its geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import drjit as dr
import numpy as np

from ..color import encode_srgb
from ..face import gain as exposure
from ..machine.runtime import mitsuba
from ..render.bounce import Bounce, Gloss
from ..render.transport import Directions, Points, Transport, shade, visibility
from ..scene.arrays import device
from ..scene.camera import Camera
from ..scene.cells import Cells
from ..scene.light import SphericalGaussians
from ..scene.maps import Maps, fill
from ..scene.mesh import Hits, Mesh, surface
from ..settings.settings import Settings
from .losses import Neighbours, censored

mi = mitsuba()

#: Order of the regions in `Problem.regions` and in stage 1's base colours (paper, section 3.1).
REGIONS = ("skin", "lips", "eyes", "eyebrows")

#: Called with (stage name, iteration, iterations, loss).
Progress = Callable[[str, int, int, float], None]


@dataclass(frozen=True)
class Evidence:
    """What is known before the optimisation, as NumPy arrays at the crop's resolution.

    image: (H, W, 3) linear sRGB. regions: (H, W, 4) soft masks in the order of REGIONS.
    mask: (H, W) bool, the pixels that get maps. weight: (H, W) trust in the photo there, 0 to 1.
    vertices: (V, 3) fitted mesh, world, cm;
    triangles: (F, 3). landmarks: (L, 2) detected points, pixels; landmark_triangle: (L,),
    landmark_barycentric: (L, 3): the same points on the mesh; landmark_weight: (L,).
    """

    image: np.ndarray
    regions: np.ndarray
    mask: np.ndarray
    weight: np.ndarray
    camera: Camera
    vertices: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    landmark_triangle: np.ndarray
    landmark_barycentric: np.ndarray
    landmark_weight: np.ndarray


@dataclass(frozen=True)
class Estimate:
    """The current answer. Maps live on the P pixels of the problem; Dr.Jit arrays, detached.

    vertices: mi.Point3f (V). log_diffuse: mi.Color3f (P). log_specular: mi.Float (P).
    perturbation: mi.Vector3f (P), world frame. axis: mi.Vector3f (K), log_sharpness and
    log_amplitude: mi.Float (K).
    """

    vertices: Any
    log_diffuse: Any
    log_specular: Any
    perturbation: Any
    axis: Any
    log_sharpness: Any
    log_amplitude: Any

    def arrays(self) -> dict[str, np.ndarray]:
        """By name, float32: (N,) or (N, 3). `of` makes the same estimate of them."""
        rows = {field.name: getattr(self, field.name).numpy().T for field in fields(self)}
        return {name: np.ascontiguousarray(values) for name, values in rows.items()}

    @staticmethod
    def of(arrays: dict[str, np.ndarray]) -> Estimate:
        """The estimate of what `arrays` gave."""
        kinds = {"vertices": mi.Point3f, "log_diffuse": mi.Color3f}
        kinds |= {"perturbation": mi.Vector3f, "axis": mi.Vector3f}
        return Estimate(
            **{name: device(kinds.get(name, mi.Float), rows) for name, rows in arrays.items()}
        )

    def light(self) -> SphericalGaussians:
        """The lobes as NumPy arrays."""
        return SphericalGaussians(
            dr.normalize(self.axis).numpy().T.copy(),
            dr.exp(self.log_sharpness).numpy(),
            dr.exp(self.log_amplitude).numpy(),
        )

    def brightened(self, gain: float) -> Estimate:
        """The same image explained by albedo times `gain` and light divided by it."""
        change = float(np.log(gain))
        return replace(
            self,
            log_diffuse=self.log_diffuse + change,
            log_specular=self.log_specular + change,
            log_amplitude=self.log_amplitude - change,
        )


class Problem:
    """The evidence on the P pixels that both the mask and the fitted mesh cover.

    Raises ValueError when the mesh and the mask do not overlap, or nothing there has any weight.
    """

    def __init__(self, evidence: Evidence, settings: Settings, progress: Progress) -> None:
        self.evidence, self.settings, self.progress = evidence, settings, progress
        self.camera = evidence.camera
        #: Stage name -> (iteration, loss) pairs.
        self.history: dict[str, list[tuple[int, float]]] = {}
        #: Of diffuse albedo (H, W, 3): the gain that makes it the skin's (exposure.py). Albedo as
        #: the stages hold it gives the picture, but inter-reflection needs the true one.
        self.skin_gain: Callable[[np.ndarray], float] = lambda albedo: exposure.conventional_gain(
            albedo.reshape(-1, 3)[self.pixel]
        )
        self.mesh = Mesh(evidence.vertices, evidence.triangles)
        hits = self.mesh.camera_hits(self.camera)
        seen = hits.pixel.numpy()
        kept = np.flatnonzero(evidence.mask.ravel()[seen])
        if not len(kept):
            raise ValueError("the fitted head and the face's mask do not overlap")
        self.hits = Hits(
            device(mi.UInt32, seen[kept]),
            dr.gather(mi.UInt32, hits.triangle, device(mi.UInt32, kept)),
        )
        self.pixel = seen[kept].astype(np.int64)
        self.target = censored(self.color(encode_srgb(evidence.image)))
        weight = evidence.weight.ravel()[self.pixel].astype(np.float64)
        if not weight.sum() > 0:
            raise ValueError("all of the face that the head covers lies in a shadow")
        self.weight = device(mi.Float, weight / weight.sum())
        self.neighbours = Neighbours.of(self.pixel, self.camera.width, self.camera.height)
        regions = evidence.regions.reshape(-1, len(REGIONS))[self.pixel].astype(np.float64)
        regions /= np.maximum(regions.sum(axis=1, keepdims=True), 1e-6)
        self.regions = regions.astype(np.float32)
        table = [getattr(settings, f"{name}_roughness") for name in REGIONS]
        self.roughness = device(mi.Float, regions @ table)

    def __len__(self) -> int:
        return len(self.pixel)

    def color(self, image: np.ndarray) -> Any:
        """mi.Color3f of width P from an image (H, W, 3)."""
        return device(mi.Color3f, image.reshape(-1, 3)[self.pixel])

    def image(self, values: Any, background: str = "nearest") -> np.ndarray:
        """(H, W) or (H, W, 3) float32 image of per-pixel values; the rest nearest or zero."""
        rows = values.numpy() if not isinstance(values, np.ndarray) else values
        rows = rows.T if rows.ndim == 2 and rows.shape[0] == 3 and len(self) != 3 else rows
        shape = (self.camera.height, self.camera.width)
        out = np.zeros((shape[0] * shape[1], *rows.shape[1:]), dtype=np.float32)
        out[self.pixel] = rows
        out = out.reshape(*shape, *rows.shape[1:])
        if background == "zero":
            return out
        known = np.zeros(shape[0] * shape[1], dtype=bool)
        known[self.pixel] = True
        return fill(out, known.reshape(shape))

    def maps(self, estimate: Estimate) -> Maps:
        """The estimate's reflectance as images, unknown pixels filled from the nearest known."""
        return Maps(
            self.image(dr.exp(estimate.log_diffuse)),
            self.image(dr.exp(estimate.log_specular)),
            self.image(self.roughness),
            self.image(estimate.perturbation, "zero"),
        )

    def move(self, vertices: Any) -> None:
        """Move the mesh; pixels that no longer hit it keep the triangle they saw last."""
        self.mesh.set_vertices(vertices)
        hits = self.mesh.camera_hits(self.camera)
        triangle = np.full(self.camera.width * self.camera.height, -1, dtype=np.int64)
        triangle[hits.pixel.numpy()] = hits.triangle.numpy()
        now = triangle[self.pixel]
        now = np.where(now < 0, self.hits.triangle.numpy(), now).astype(np.uint32)
        self.hits = Hits(self.hits.pixel, device(mi.UInt32, now))

    def place(self, vertices: Any, triangle: np.ndarray) -> None:
        """Put the mesh where `move` left it, when the pixels saw the triangles (P,)."""
        self.mesh.set_vertices(vertices)
        self.hits = Hits(self.hits.pixel, device(mi.UInt32, triangle))

    def points(self, diffuse_normal: Any = None, specular_normal: Any = None) -> Points:
        """Shading points of the P pixels on the mesh as it is, with other normals if given."""
        mesh = self.mesh
        position, normal, geometric = surface(
            self.camera, self.hits, mesh.vertices, mesh.normals, mesh.triangles
        )
        dr.eval(position, normal, geometric)
        return Points(
            position,
            normal if diffuse_normal is None else diffuse_normal,
            normal if specular_normal is None else specular_normal,
            geometric,
            self.roughness,
        )


class Shading:
    """Everything that depends on the geometry and the quadrature: visibility, indirect light.

    `indirect` (E, S: mi.Color3f of width P) is held constant between two calls of `update`. gloss:
    what inter-reflection carries of the highlights; None has it computed for the next light.
    """

    def __init__(self, problem: Problem, cells: Cells, factors: Bounce | None = None) -> None:
        self.problem, self.cells = problem, cells
        self.directions = Directions(cells)
        self.points = problem.points()
        self.bits = visibility(problem.mesh.scene, self.points, self.directions)
        self.factors = factors or self._factors()
        self.bounce = self.factors.under(self.directions)
        self.indirect: tuple[Any, Any] = (mi.Color3f(0), mi.Color3f(0))
        self.gloss: Gloss | None = None

    def _factors(self) -> Bounce:
        problem = self.problem
        roughness = problem.image(problem.roughness)
        bounces = problem.settings.bounces
        return Bounce(problem.mesh, problem.camera, problem.hits, roughness, bounces)

    def under(self, cells: Cells) -> Shading:
        """The same geometry under another quadrature: form factors do not depend on it."""
        return Shading(self.problem, cells, self.factors)

    def update(self, radiance: np.ndarray, maps: Maps, gain: float | None = None) -> None:
        """Bring the indirect light up to date with the light's cell means (D,) and the maps.

        gain: of albedo, the problem's if None; 1 for maps that have it already.
        """
        maps = maps.brightened(
            self.problem.skin_gain(maps.diffuse_albedo) if gain is None else gain
        )
        change = self.problem.settings.gloss_change
        flux = self.directions.flux(radiance)
        if self.gloss is None or self.gloss.change(flux) > change:
            self.gloss = self.bounce.gloss(radiance)
        e, s = self.bounce.shade(radiance, maps, self.gloss)
        self.indirect = (device(mi.Color3f, e), device(mi.Color3f, s))

    def shade(self, radiance: np.ndarray) -> tuple[Any, Any]:
        """Direct plus indirect E and S, mi.Color3f of width P, with the current normals."""
        e, s = shade(self.points, self.directions, self.bits, radiance)
        return mi.Color3f(e) + self.indirect[0], mi.Color3f(s) + self.indirect[1]


class LightSample:
    """An even sample of the pixels, enough for the light's few unknowns (stages 1 to 3).

    Its transport is tabulated once, so that the light's gradient is two matrix products; the
    indirect light of `shading` is taken as it stands at each call.
    """

    def __init__(self, problem: Problem, shading: Shading) -> None:
        settings = problem.settings
        count = min(settings.light_points, len(problem))
        self.rows = np.unique(np.linspace(0, len(problem) - 1, count).astype(np.uint32))
        self.index = device(mi.UInt32, self.rows)
        points = shading.points.gather(self.index)
        bits = visibility(problem.mesh.scene, points, shading.directions)
        self.transport = Transport(points, shading.directions, bits)
        self.target = self.of(problem.target)
        self.weight = self.of(problem.weight)
        self.weight /= dr.sum(self.weight)
        dr.eval(self.target, self.weight)

    def of(self, values: Any) -> Any:
        """The sample of per-pixel values, of their own type."""
        return dr.gather(type(values), values, self.index)
