"""The obvious alternative: the same guided stages driven by stock Mitsuba `prb`.

What Mitsuba ships can express stages 1, 2 and 5: base colours and light, a smooth albedo map, a
sharp one; `roughplastic` (Beckmann 0.30, index of refraction 1.38) for skin, an environment map
of 18 x 36 grey texels for the light, the losses and rates of Table 1. Stages 3 and 4 are left out;
instead it is *given* the mesh that unlit ends with. That is a choice of this baseline, not a limit
of Mitsuba: stock has `normalmap` and `bumpmap`, textured gloss, and materials that blend two
others, each with its own normals. Adam, `SAMPLES` per pixel, `ITERATIONS` of each stage, a small
share of the schedule.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import drjit as dr

from unlit.evaluate.metrics import best_gain, compare, psnr
from unlit.evaluate.protocol import Shot, ShotResult
from unlit.evaluate.truth import KnownSubject
from unlit.face.reconstruction import Reconstruction
from unlit.machine.runtime import mitsuba
from unlit.optimize.losses import encode
from unlit.perception.regions import REGIONS
from unlit.render.reference import mesh_body, mitsuba_environment
from unlit.scene.arrays import device
from unlit.scene.mesh import Mesh
from unlit.settings.table1 import TABLE_1

mi = mitsuba()

SAMPLES = 16
ITERATIONS = {"stage1": 80, "stage2": 80, "stage5": 20}
_GRID = (18, 36)
_RATE = 0.05


@dataclass(frozen=True)
class Baseline:
    """diffuse_albedo: (S, S, 3) linear. seconds: of one iteration, the median."""

    diffuse_albedo: np.ndarray
    seconds: float
    face: Reconstruction

    def relight(self, environment: np.ndarray, samples: int) -> np.ndarray:
        """(S, S, 3) linear, path-traced with the baseline's own material."""
        light = {"type": "envmap", "bitmap": mitsuba_environment(environment)}
        scene = _scene(self.face, mi.TensorXf(self.diffuse_albedo), light, SAMPLES, "path", 5)
        return mi.render(scene, spp=samples, seed=7).numpy()[..., :3]


def _scene(
    face: Reconstruction, albedo: Any, light: dict[str, Any], samples: int, kind: str, depth: int
) -> Any:
    """The face's mesh with `albedo` (S, S, 3) projected onto it as a texture."""
    material = mi.load_dict(
        {
            "type": "roughplastic",
            "distribution": "beckmann",
            "alpha": 0.3,
            "int_ior": 1.38,
            "diffuse_reflectance": {
                "type": "bitmap",
                "data": albedo,
                "raw": True,
                "wrap_mode": "clamp",
            },
        }
    )
    mesh = Mesh(face.face.mesh.vertices, face.face.mesh.triangles)
    size = (face.face.camera.width, face.face.camera.height)
    # The texture's first row is v = 0 here, as `data` is not flipped.
    uv = device(mi.Point2f, face.face.camera.project(face.face.mesh.vertices) / size)
    body = mesh_body("face", material, mesh.vertices, mesh.normals, mesh.triangles, uv)
    integrator = {"type": kind, "max_depth": depth, "hide_emitters": True}
    return mi.load_dict(
        {
            "type": "scene",
            "face": body,
            "light": light,
            "sensor": face.face.camera.mitsuba_sensor(samples),
            "integrator": integrator,
        }
    )


def fit(face: Reconstruction) -> Baseline:
    """Fit albedo and light to `face.image` on the mesh of `face`."""
    size = face.face.camera.width
    grey = np.full((*_GRID, 3), 0.5, np.float32)
    light = {"type": "envmap", "bitmap": mi.Bitmap(grey)}
    start = mi.TensorXf(np.full((size, size, 3), 0.4, np.float32))
    scene = _scene(face, start, light, SAMPLES, "prb", 3)
    parameters = mi.traverse(scene)
    names = {
        end: next(name for name in parameters.keys() if name.endswith(end))  # noqa: SIM118
        for end in ("diffuse_reflectance.data", "light.data")
    }
    parameters.keep(list(names.values()))
    albedo_name, light_name = names.values()
    # Mitsuba repeats the first columns behind the last.
    rows, columns, _ = parameters[light_name].shape
    texel = np.arange(rows)[:, None] * _GRID[1] + np.arange(columns)[None, :] % _GRID[1]
    texel_of = device(mi.UInt32, np.repeat(texel.ravel(), 3))
    weights = face.photo.regions.weights[..., :-1].reshape(-1, len(REGIONS))
    weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-6)
    weights[weights.sum(axis=1) < 0.5] = np.arange(len(REGIONS)) == 0
    regions = [device(mi.Float, np.repeat(w, 3)) for w in weights.T]
    channel = device(mi.UInt32, np.tile(np.arange(3), size * size))
    mask = np.repeat((face.face.mask > 0.5).ravel(), 3)
    inside = device(mi.Float, mask / mask.sum())
    target = encode(device(mi.Float, np.clip(face.photo.image, 0, 1).ravel()))
    here = (face.face.mask > 0.5).astype(np.float32)
    pairs = [
        device(mi.Float, np.repeat((here[:, 1:] * here[:, :-1]).ravel(), 3)),
        device(mi.Float, np.repeat((here[1:] * here[:-1]).ravel(), 3)),
    ]

    optimizer = mi.ad.Adam(lr=_RATE)
    optimizer["light"] = mi.Float(np.full(_GRID[0] * _GRID[1], np.log(0.5), np.float32))
    colour = np.median(face.photo.image[face.face.mask > 0.5], axis=0)
    optimizer["base"] = device(mi.Float, np.log(np.tile(np.maximum(colour, 1e-3), 4)))
    times: list[float] = []
    seed = 0
    for stage, count in ITERATIONS.items():
        if stage == "stage2":
            optimizer["map"] = dr.detach(_spread(optimizer["base"], regions, channel))
        smooth = TABLE_1[stage].diffuse_smoothness
        for _ in range(count):
            begin = time.perf_counter()
            if stage == "stage1":
                log = _spread(optimizer["base"], regions, channel)
            else:
                log = optimizer["map"]
            parameters[albedo_name] = mi.TensorXf(dr.minimum(dr.exp(log), 1.0), (size, size, 3))
            radiance = dr.gather(mi.Float, dr.exp(optimizer["light"]), texel_of)
            parameters[light_name] = mi.TensorXf(radiance, (rows, columns, 3))
            parameters.update()
            image = mi.render(scene, parameters, spp=SAMPLES, seed=seed)
            loss = dr.sum(dr.abs(encode(image.array) - target) * inside)
            if smooth:
                loss += smooth * _variation(log, size, pairs) / (mask.sum())
            dr.backward(loss)
            optimizer.step()
            dr.eval(optimizer["light"])
            dr.sync_thread()
            times.append(time.perf_counter() - begin)
            seed += 1
    albedo = np.minimum(np.exp(optimizer["map"].numpy()), 1).reshape(size, size, 3)
    return Baseline(albedo.astype(np.float32), float(np.median(times)), face)


def _spread(base: Any, regions: list[Any], channel: Any) -> Any:
    """Log of the regions' base colours, blended by their masks; (S S 3,)."""
    parts: Any = sum(
        weight * dr.exp(dr.gather(mi.Float, base, channel + 3 * k))
        for k, weight in enumerate(regions)
    )
    return dr.log(parts)


def _variation(log: Any, size: int, pairs: list[Any]) -> Any:
    """Total variation of the log albedo inside the face, summed."""
    image = mi.TensorXf(log, (size, size, 3))
    across = dr.abs(image[:, 1:] - image[:, :-1]).array * pairs[0]
    down = dr.abs(image[1:] - image[:-1]).array * pairs[1]
    return dr.sum(across) + dr.sum(down)


def baseline_rows(
    subject: KnownSubject, name: str, rows: list[ShotResult], shots: tuple[Shot, ...]
) -> list[tuple[str, ...]]:
    """Table lines: unlit and the baseline on each input of one subject."""
    true = subject.truth.diffuse_albedo
    iterations = sum(stage.iterations for stage in TABLE_1.values())
    lines = []
    for row in rows:
        seconds = sum(v for k, v in row.face.metrics.seconds.items() if k.startswith("stage"))
        settings = row.face.settings
        own = seconds / max(1, sum(getattr(settings, stage).iterations for stage in TABLE_1))
        ours = [cell.metrics["gained"]["face"] for cell in row.relit]
        found = fit(row.face)
        truth = row.maps["albedo_psnr"]
        lines.append(_line(name, row.light, "unlit", own, iterations, ours, truth))
        relit = [found.relight(shot.light.environment, 64) for shot in shots]
        theirs = [
            compare(image, shot.image, row.mask)["gained"]["face"]
            for image, shot in zip(relit, shots, strict=True)
        ]
        gain = best_gain(found.diffuse_albedo, true, row.mask)
        there = psnr(found.diffuse_albedo * gain, true, row.mask)
        stages = " + ".join(map(str, ITERATIONS.values()))
        label = f"prb, {SAMPLES} samples, {stages} iterations"
        lines.append(_line(name, row.light, label, found.seconds, iterations, theirs, there))
    return lines


def _line(
    name: str,
    light: str,
    method: str,
    seconds: float,
    iterations: int,
    cells: list[dict[str, float]],
    albedo: float,
) -> tuple[str, ...]:
    relit = (f"{cell['psnr']:.1f} / {cell['lpips']:.3f}" for cell in cells)
    whole = f"{seconds * iterations / 60:.0f} min"
    return (name, light, method, f"{1000 * seconds:.0f}", whole, *relit, f"{albedo:.1f}")
