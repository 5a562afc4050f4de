"""Errors of the gradients of the image loss, parameter by parameter.

    python benchmarks/gradients.py [--size 128] [--directions 8] [--quick]

Every derivative the optimiser uses (transport for the light, linearised shading for normals and
vertices) is held against central differences of the exact renderer along random directions;
visibility is fixed in both. The gradient of the diffuse albedo is also compared with Mitsuba's
own differentiable path tracer (`prb`) on the same plugin.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import drjit as dr

from unlit.color import UNCLIPPED
from unlit.machine.runtime import mitsuba
from unlit.optimize.blur import Blur
from unlit.optimize.losses import image_l1
from unlit.render.interreflection import Interreflection
from unlit.render.transport import (
    Quadrature,
    ShadingPoints,
    Transport,
    linearize,
    shade,
    visibility,
)
from unlit.scene.camera import Camera
from unlit.scene.cells import grid_cells
from unlit.scene.light import SphericalGaussians, disc, grid_lobes
from unlit.scene.lobes import CellRadiance
from unlit.scene.maps import DIFFUSE_BLUR, Maps
from unlit.scene.mesh import Mesh, surface, vertex_normals

mi = mitsuba()

#: Step of the central differences, in the parameter's own unit, along a direction whose elements
#: are standard normal (smoothed over the mesh for the vertices, cm). Small for the normals: each
#: cell of the light that sets behind the horizon within a step puts a kink into the shading.
STEPS = {
    "log_diffuse": 0.01,
    "log_specular": 0.02,
    "axis": 0.004,
    "log_sharpness": 0.02,
    "log_amplitude": 0.02,
    "perturbation": 0.0002,
    "vertices": 0.0015,
}


@dataclass(frozen=True)
class Result:
    """Directional derivatives (n,) of one parameter: ours and by central differences."""

    ours: np.ndarray
    numeric: np.ndarray

    @property
    def error(self) -> float:
        """Relative error of the derivatives, root mean square over the directions."""
        return float(np.linalg.norm(self.ours - self.numeric) / np.linalg.norm(self.numeric))


class Case:
    """A head in front of a camera, a state of all parameters, and a photo it does not match."""

    def __init__(
        self, vertices: np.ndarray, triangles: np.ndarray, camera: Camera, maps: Maps, seed: int = 0
    ) -> None:
        rng = np.random.default_rng(seed)
        self.camera, self.triangles = camera, triangles
        self.mesh = Mesh(vertices, triangles)
        self.hits = self.mesh.camera_hits(camera)
        self.pixel = self.hits.pixel.numpy().astype(np.int64)
        self.cells = grid_cells()
        self.quadrature = Quadrature(self.cells)
        self.lobes = CellRadiance(self.cells)
        self.roughness = mi.Float(maps.roughness.ravel()[self.pixel])
        size = camera.width, camera.height
        self.blur = Blur(self.pixel, *size, DIFFUSE_BLUR)
        light = _light(rng)
        self.state = {
            "log_diffuse": np.log(maps.diffuse_albedo.reshape(-1, 3)[self.pixel].T),
            "log_specular": np.log(maps.specular_albedo.ravel()[self.pixel]),
            "axis": light.axis.T,
            "log_sharpness": np.log(light.sharpness),
            "log_amplitude": np.log(light.amplitude),
            "perturbation": maps.perturbation.reshape(-1, 3)[self.pixel].T,
            "vertices": vertices.T.astype(np.float64),
        }
        points = self.points(self.state)
        self.bits = visibility(self.mesh.scene, points, self.quadrature)
        interreflection = Interreflection(self.mesh, camera, self.hits, maps.roughness, 3)
        radiance = self.radiance(self.state)
        e, s = interreflection.under(self.quadrature).shade(radiance, maps)
        self.indirect = mi.Color3f(e.T.copy()), mi.Color3f(s.T.copy())
        # Facing pixels only: at grazing angles a finite step in the normal leaves the hemisphere.
        facing = dr.dot(points.specular_normal, points.to_viewer).numpy() > 0.25
        self.weight = np.where(facing, rng.uniform(0.5, 1.5, len(self.pixel)), 0)
        self.weight /= self.weight.sum()
        # Off by enough that no step crosses the kink of the L1 loss at most pixels.
        shape = (3, len(self.pixel))
        noise = rng.choice([-1, 1], shape) * rng.uniform(0.02, 0.1, shape)
        self.target = np.clip(_encode(self.render(self.state)) + noise, *UNCLIPPED)

    def radiance(self, state: dict[str, Any]) -> np.ndarray:
        axis = state["axis"] / np.linalg.norm(state["axis"], axis=0)
        light = SphericalGaussians(
            axis.T.astype(np.float32),
            np.exp(state["log_sharpness"]).astype(np.float32),
            np.exp(state["log_amplitude"]).astype(np.float32),
        )
        return self.lobes.of(light)

    def normals(self, vertices: Any, perturbation: Any) -> tuple[Any, Any, Any, Any]:
        """Position, diffuse, specular and geometric normal at the pixels; differentiable."""
        smooth = vertex_normals(vertices, self.mesh.corners)
        position, normal, geometric = surface(
            self.camera, self.hits, vertices, smooth, self.mesh.triangles
        )
        specular = dr.normalize(normal + perturbation)
        return position, dr.normalize(normal + self.blur(perturbation)), specular, geometric

    def points(self, state: dict[str, Any]) -> ShadingPoints:
        position, diffuse, specular, geometric = self.normals(
            mi.Point3f(state["vertices"].astype(np.float32)),
            mi.Vector3f(state["perturbation"].astype(np.float32)),
        )
        return ShadingPoints(position, diffuse, specular, geometric, self.roughness)

    def render(self, state: dict[str, Any]) -> np.ndarray:
        """Exact image (3, P), float64, with visibility and indirect light as at the start."""
        e, s = shade(self.points(state), self.quadrature, self.bits, self.radiance(state))
        e, s = (
            x.numpy().astype(np.float64) + more.numpy()
            for x, more in zip((e, s), self.indirect, strict=True)
        )
        return np.exp(state["log_diffuse"]) * e + np.exp(state["log_specular"]) * s

    def loss(self, state: dict[str, Any]) -> float:
        """The stages' image loss, in double precision."""
        difference = np.abs(np.clip(_encode(self.render(state)), *UNCLIPPED) - self.target)
        return float((self.weight * difference).sum() / 3)

    def gradients(self) -> dict[str, np.ndarray]:
        """Gradients of the image loss as the stages compute them, shaped like the state."""
        state = {
            name: (mi.Float if value.ndim == 1 else mi.Vector3f)(value.astype(np.float32))
            for name, value in self.state.items()
        }
        state["vertices"] = mi.Point3f(state["vertices"])
        for value in state.values():
            dr.enable_grad(value)
        points = self.points(self.state)
        target, weight = mi.Color3f(self.target.astype(np.float32)), mi.Float(self.weight)

        def backward(log_diffuse: Any, log_specular: Any, e: Any, s: Any) -> None:
            e, s = e + self.indirect[0], s + self.indirect[1]
            image = dr.exp(mi.Color3f(log_diffuse)) * e + dr.exp(log_specular) * s
            dr.backward(image_l1(image, target, weight))

        light = Transport(points, self.quadrature, self.bits)
        radiance = self.lobes(
            dr.normalize(state["axis"]),
            dr.exp(state["log_sharpness"]),
            dr.exp(state["log_amplitude"]),
        )
        maps = state["log_diffuse"], state["log_specular"]
        backward(*maps, *light.shade(radiance))
        local = linearize(points, self.quadrature, self.bits, dr.detach(radiance).numpy())
        _, diffuse, specular, _ = self.normals(state["vertices"], state["perturbation"])
        held_diffuse, held_specular = (dr.detach(m) for m in maps)
        backward(held_diffuse, held_specular, *local.shade(diffuse, specular))
        return {name: dr.grad(value).numpy().astype(np.float64) for name, value in state.items()}

    def check(self, count: int) -> dict[str, Result]:
        """Derivatives of every parameter along `count` random directions each."""
        gradients, results = self.gradients(), {}
        for name, step in STEPS.items():
            rng = np.random.default_rng(1)
            start, ours, numeric = self.state[name], [], []
            for _ in range(count):
                direction = rng.standard_normal(start.shape)
                if name == "vertices":
                    direction = self._smooth(direction)
                ends = [
                    self.loss({**self.state, name: start + sign * step * direction})
                    for sign in (1, -1)
                ]
                ours.append((gradients[name] * direction).sum())
                numeric.append((ends[0] - ends[1]) / (2 * step))
            results[name] = Result(np.array(ours), np.array(numeric))
        return results

    def _smooth(self, direction: np.ndarray, passes: int = 10) -> np.ndarray:
        """A displacement that keeps triangles in shape, as the preconditioned shape step does."""
        ends = np.concatenate([self.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
        degree = np.bincount(ends[:, 0], minlength=direction.shape[1])
        for _ in range(passes):
            near = [np.bincount(ends[:, 0], d[ends[:, 1]], direction.shape[1]) for d in direction]
            direction = 0.5 * direction + 0.5 * np.array(near) / np.maximum(degree, 1)
        return direction / direction.std()


def _encode(linear: np.ndarray) -> np.ndarray:
    linear = np.maximum(linear, 1e-5)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _light(rng: np.random.Generator) -> SphericalGaussians:
    """The 648 lobes half-way through a fit: uneven amplitudes, sharpnesses and axes."""
    start = grid_lobes(46.0, 0.5)
    axis = start.axis + 0.05 * rng.standard_normal(start.axis.shape)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    side = np.exp(3 * (axis @ (0.6, 0.4, 0.7) - 1))
    return SphericalGaussians(
        axis.astype(np.float32),
        start.sharpness * np.exp(0.3 * rng.standard_normal(648)).astype(np.float32),
        (start.amplitude * (0.3 + 3 * side) * rng.uniform(0.5, 1.5, 648)).astype(np.float32),
    )


def albedo_beside_mitsuba(
    vertices: np.ndarray, triangles: np.ndarray, camera: Camera, maps: Maps, samples: int
) -> tuple[float, float]:
    """Gradient of a weighted sum of pixels with respect to the diffuse albedo: ours and `prb`.

    Returns (mean relative difference, bias) of the two gradient images in the red channel, after
    a 5 x 5 box filter, inside the face. Direct light: a disc at 60 degrees.
    """
    from unlit.render.reference import PLUGIN, mesh_body, mitsuba_environment

    environment = disc((0.87, 0.0, 0.5), half_angle=10.0)
    mesh = Mesh(vertices, triangles)
    hits = mesh.camera_hits(camera)
    position, normal, geometric = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    points = ShadingPoints(
        position, normal, normal, geometric, dr.full(mi.Float, 0.3, dr.width(normal))
    )
    cells = grid_cells(72, 144)
    bits = visibility(mesh.scene, points, Quadrature(cells))
    e, _ = shade(points, Quadrature(cells), bits, cells.average(environment))
    ours = np.zeros(camera.width * camera.height)
    ours[hits.pixel.numpy()] = e.numpy()
    ours = ours.reshape(camera.height, camera.width)

    face = mi.load_dict({"type": PLUGIN})
    face.set_maps(camera, replace(maps, perturbation=np.zeros_like(maps.perturbation)))
    texture = face.textures["diffuse_albedo"]
    tensor = mi.TensorXf(maps.diffuse_albedo)
    dr.enable_grad(tensor)
    texture.set_tensor(tensor)
    body = mesh_body("face", face, mesh.vertices, mesh.normals, mesh.triangles)
    scene = mi.load_dict(
        {
            "type": "scene",
            "face": body,
            "light": {"type": "envmap", "bitmap": mitsuba_environment(environment)},
            "sensor": camera.mitsuba_sensor(samples),
        }
    )
    integrator = mi.load_dict({"type": "prb", "max_depth": 2, "hide_emitters": True})
    unit = np.ones((camera.height, camera.width, 3), np.float32)
    integrator.render_backward(
        scene, None, mi.TensorXf(unit), sensor=scene.sensors()[0], seed=1, spp=samples
    )
    theirs = dr.grad(tensor).numpy().reshape(camera.height, camera.width, 3)[..., 0]
    inside = np.asarray(ndimage.binary_erosion(ours > 0, iterations=5), bool)
    a, b = (ndimage.uniform_filter(x, 5)[inside] for x in (ours, theirs))
    return float(np.abs(a - b).mean() / b.mean()), float(a.mean() / b.mean() - 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=128, help="pixels on a side")
    parser.add_argument("--directions", type=int, default=8, help="random directions per parameter")
    parser.add_argument("--quick", action="store_true", help="64 pixels, 3 directions")
    options = parser.parse_args()
    size, count = (64, 3) if options.quick else (options.size, options.directions)
    from common import portrait

    head = portrait(size)
    case = Case(*head)
    print(f"{size} x {size}, {len(case.pixel)} pixels, {count} random directions each")
    print(f"{'parameter':30s} {'error %':>8s}   first directions, ours / central differences")
    for title, result in case.check(count).items():
        pairs = "  ".join(
            f"{a:.3e} / {b:.3e}" for a, b in zip(result.ours[:2], result.numeric[:2], strict=True)
        )
        print(f"{title:30s} {100 * result.error:8.3f}   {pairs}", flush=True)
    error, bias = albedo_beside_mitsuba(*head, samples=64 if options.quick else 512)
    print(
        f"diffuse albedo beside Mitsuba prb: mean difference {100 * error:.2f} %, "
        f"bias {100 * bias:+.2f} %"
    )


if __name__ == "__main__":
    main()
