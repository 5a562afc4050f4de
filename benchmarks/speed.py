"""Milliseconds per iteration of each stage, beside stock Mitsuba's differentiable path tracer.

    python benchmarks/speed.py [--size 512] [--share 0.1] [--quick]

Each stage runs `share` of its iterations, on the default head under a made-up light. Its rate is
taken between progress reports (with the periodic refreshes); what else the stage takes, tracing
and compiling kernels, is its set-up. Mitsuba's row is one iteration of inverse
rendering with what it ships: `prb`, max_depth 2, 16 samples per pixel, the same mesh, camera and
texture size, a `principled` material with differentiable bitmaps, an environment map, Adam.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import Any

import numpy as np
from common import portrait
from threadpoolctl import threadpool_limits

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import drjit as dr

from unlit.face.gain import AlbedoGain
from unlit.head.sources.library import default_model
from unlit.machine.runtime import mitsuba
from unlit.optimize.observation import Observation
from unlit.optimize.problem import Problem
from unlit.optimize.stages import run_stages
from unlit.perception.regions import REGIONS
from unlit.render.reference import mesh_body
from unlit.render.relighter import image_from_shading
from unlit.render.transport import Quadrature, ShadingPoints, shade, visibility
from unlit.scene.arrays import device
from unlit.scene.camera import Camera
from unlit.scene.cells import grid_cells
from unlit.scene.light import SphericalGaussians
from unlit.scene.maps import Maps
from unlit.scene.mesh import Mesh, surface
from unlit.settings.settings import PRESETS
from unlit.settings.table1 import TABLE_1

mi = mitsuba()


def observed(
    vertices: np.ndarray, triangles: np.ndarray, camera: Camera, maps: Maps
) -> Observation:
    """The head's own rendering as the photo, every seen pixel of the face as skin."""
    mesh = Mesh(vertices, triangles)
    hits = mesh.camera_hits(camera)
    position, normal, geometric = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    pixel = hits.pixel.numpy().astype(np.int64)
    points = ShadingPoints(
        position, normal, normal, geometric, mi.Float(maps.roughness.ravel()[pixel])
    )
    cells = grid_cells()
    axis = np.array([[0.7, 0.3, 0.65], [-0.5, 0.2, 0.8]], np.float32)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    light = SphericalGaussians(axis, np.array([15, 3], "f4"), np.array([3.0, 0.6], "f4"))
    quadrature = Quadrature(cells)
    bits = visibility(mesh.scene, points, quadrature)
    radiance = cells.average(light.rasterize())
    e, s = (x.numpy()[:, None] for x in shade(points, quadrature, bits, radiance))
    image = image_from_shading(maps, pixel, e, s)
    model = default_model()
    marks = model.landmarks(vertices)
    known = model.landmark_points.triangle >= 0
    size = camera.height, camera.width
    seen = np.zeros(size, dtype=bool)
    seen.ravel()[pixel] = True
    # Such a share of the crop as a face has, at its centre.
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / np.array(size)[:, None, None] - 0.5
    mask = seen & ((x / 0.31) ** 2 + (y / 0.42) ** 2 < 1)
    regions = np.zeros((*size, len(REGIONS)), np.float32)
    regions[..., 0] = 1
    return Observation(
        image=image,
        regions=regions,
        mask=mask,
        weight=mask.astype(np.float32),
        fitted=mask,
        camera=camera,
        vertices=vertices,
        triangles=triangles,
        landmarks=camera.project(np.where(known[:, None], marks, -1.0)),
        landmark_points=model.landmark_points,
    )


def stages(
    head: tuple[np.ndarray, np.ndarray, Camera, Maps], share: float, **changes: Any
) -> dict[str, Any]:
    """Stage -> (ms per iteration, set-up in seconds), and the number of pixels under "pixels".

    changes: further settings that differ from `paper`.
    """
    settings = replace(
        PRESETS["paper"],
        **changes,
        **{
            n: replace(s, iterations=max(76, round(s.iterations * share)))
            for n, s in TABLE_1.items()
        },
    )
    reports: dict[str, list[tuple[int, float]]] = {}
    ends: dict[str, float] = {}

    def progress(stage: str, iteration: int, iterations: int, loss: float) -> None:
        reports.setdefault(stage, []).append((iteration, time.perf_counter()))

    def after(stage: str, *_: Any) -> None:
        ends[stage] = time.perf_counter()

    problem = Problem(observed(*head), settings, AlbedoGain(), progress)
    rows: dict[str, Any] = {"pixels": len(problem)}
    begin = time.perf_counter()
    with threadpool_limits(1, user_api="blas"):
        run_stages(problem, after)
    for name in TABLE_1:
        marks = reports[name]
        # From the second report, as the first iterations compile kernels, over whole intervals
        # between refreshes.
        first, start = marks[1]
        last, stop = [m for m in marks[2:] if (m[0] - first) % settings.refresh_interval == 0][-1]
        pace = (stop - start) / (last - first)
        setup = ends[name] - begin - pace * getattr(settings, name).iterations
        rows[name] = (1000 * pace, max(setup, 0.0))
        begin = ends[name]
    return rows


def prb(
    head: tuple[np.ndarray, np.ndarray, Camera, Maps], samples: int, iterations: int
) -> list[float]:
    """Seconds of each of `iterations` steps of stock Mitsuba, after one that compiles."""
    vertices, triangles, camera, maps = head
    uv = camera.project(vertices) / (camera.width, camera.height)

    def bitmap(image: np.ndarray) -> dict[str, Any]:
        data = mi.TensorXf(np.ascontiguousarray(image, np.float32))
        return {"type": "bitmap", "data": data, "raw": True, "wrap_mode": "clamp"}

    material = mi.load_dict(
        {
            "type": "principled",
            "base_color": bitmap(maps.diffuse_albedo),
            "roughness": bitmap(maps.roughness[..., None]),
            "specular": 0.4,
        }
    )
    mesh = Mesh(vertices, triangles)
    corners = device(mi.Point2f, uv)
    body = mesh_body("face", material, mesh.vertices, mesh.normals, mesh.triangles, corners)
    sky = mi.Bitmap(np.full((180, 360, 3), 0.5, np.float32))
    scene = mi.load_dict(
        {
            "type": "scene",
            "face": body,
            "light": {"type": "envmap", "bitmap": sky},
            "sensor": camera.mitsuba_sensor(samples),
            "integrator": {"type": "prb", "max_depth": 2, "hide_emitters": True},
        }
    )
    parameters = mi.traverse(scene)
    kept = ("base_color.data", "roughness.data", "light.data")
    names = [name for name in parameters.keys() if name.endswith(kept)]  # noqa: SIM118
    assert len(names) == len(kept), names
    parameters.keep(names)
    optimizer = mi.ad.Adam(lr=0.01)
    for name in names:
        optimizer[name] = parameters[name]
    parameters.update(optimizer)
    times = []
    for k in range(iterations + 1):
        begin = time.perf_counter()
        image = mi.render(scene, parameters, spp=samples, seed=k)
        dr.backward(dr.mean(dr.abs(image - 0.3), axis=None))
        optimizer.step()
        parameters.update(optimizer)
        dr.eval(*(parameters[n] for n in names))
        dr.sync_thread()
        times.append(time.perf_counter() - begin)
        print(f"  Mitsuba prb iteration {k}: {times[-1]:.2f} s", flush=True)
    return times[1:]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=512, help="pixels on a side")
    parser.add_argument(
        "--share", type=float, default=0.1, help="of each stage's iterations to run"
    )
    parser.add_argument("--samples", type=int, default=16, help="Mitsuba's, per pixel")
    parser.add_argument("--quick", action="store_true", help="128 pixels, 2 samples")
    options = parser.parse_args()
    size, samples = (128, 2) if options.quick else (options.size, options.samples)
    head = portrait(size)
    print(f"{size} x {size}, {len(head[0])} vertices, {len(head[1])} triangles", flush=True)
    rows = stages(head, options.share)
    print(f"{rows.pop('pixels')} face pixels")
    print(f"{'stage':8s}{'iterations':>12s}{'ms/iteration':>14s}{'set-up s':>10s}{'total s':>9s}")
    total, count = 0.0, 0
    for name, (pace, setup) in rows.items():
        iterations = TABLE_1[name].iterations
        seconds = pace * iterations / 1000 + setup
        total, count = total + seconds, count + iterations
        print(f"{name:8s}{iterations:12d}{pace:14.1f}{setup:10.1f}{seconds:9.1f}")
    print(f"{'all':8s}{count:12d}{1000 * total / count:14.1f}{'':10s}{total:9.1f}", flush=True)
    seconds = float(np.median(prb(head, samples, 3)))
    print(
        f"Mitsuba prb, max_depth 2, {samples} samples: {1000 * seconds:.0f} ms/iteration, "
        f"{seconds * count / 3600:.1f} h for {count} iterations: "
        f"{seconds * count / total:.0f} times as long"
    )


if __name__ == "__main__":
    main()
