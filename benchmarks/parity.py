"""The transport renderer beside the Mitsuba path tracer: same mesh, reflectance and light.

    python benchmarks/parity.py [--size 512] [--samples 512] [--hdri FILE] [--quick]

Both images are filtered with the same 5 x 5 box, so that little of the reference's noise is left;
compared inside the face (the hull of the landmarks, off the silhouette). Columns, in per cent:

    mean    mean absolute difference over the reference's mean
    bias    difference of the means
    p95     95th percentile over the pixels of the difference relative to the pixel's own value,
            or to a tenth of the mean where it is darker than that
    noise   what `mean` would be from the reference's own noise, from two halves of its samples
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from common import portrait
from scipy import ndimage, optimize

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import drjit as dr

from unlit.head.sources.library import default_model
from unlit.machine.runtime import mitsuba
from unlit.render.interreflection import Interreflection
from unlit.render.reference import path_trace
from unlit.render.relighter import image_from_shading
from unlit.render.transport import Quadrature, ShadingPoints, shade, visibility
from unlit.scene.cells import grid_cells, refine
from unlit.scene.light import (
    GRID,
    SphericalGaussians,
    disc,
    flash,
    grid_lobes,
    latlong_directions,
    latlong_solid_angles,
    uniform,
)
from unlit.scene.maps import Maps
from unlit.scene.mesh import CameraHits, Mesh, surface

mi = mitsuba()


def gaussians_of(environment: np.ndarray) -> SphericalGaussians:
    """648 lobes on the grid, non-negative least squares fit to the means over the grid's cells."""
    lobes = grid_lobes(46.0, 1.0)
    weight = np.sqrt(latlong_solid_angles(*GRID).ravel())
    directions = latlong_directions(*GRID).reshape(-1, 3)
    matrix = np.exp(lobes.sharpness * (directions @ lobes.axis.T - 1))
    means = grid_cells().average(environment)
    amplitude, _ = optimize.nnls(matrix * weight[:, None], means * weight)
    return SphericalGaussians(lobes.axis, lobes.sharpness, amplitude.astype(np.float32))


def panorama(path: Path | None) -> np.ndarray:
    """A photographed environment (H, W), monochrome, of mean radiance 1; else a made-up sky."""
    if path is not None:
        image = np.array(
            mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
        )
        mono = image.mean(axis=2)
    else:
        d = latlong_directions(180, 360)
        sun = np.array([0.5, 0.5, 0.7]) / np.linalg.norm([0.5, 0.5, 0.7])
        mono = np.where(d[..., 1] > 0, 0.4 + 0.6 * d[..., 1], 0.15)
        mono += 40 * np.exp(200 * (d @ sun - 1)) + 3 * np.exp(8 * (d @ (-0.8, 0.3, 0.5) - 1))
    return (mono / np.average(mono, weights=latlong_solid_angles(*mono.shape))).astype(np.float32)


class Head:
    """The default head: its G-buffer, for the transport renderer."""

    def __init__(self, size: int) -> None:
        vertices, triangles, self.camera, self.maps = portrait(size)
        self.mesh = Mesh(vertices, triangles)
        self.hits: CameraHits = self.mesh.camera_hits(self.camera)
        self.pixel = self.hits.pixel.numpy().astype(np.int64)
        position, normal, geometric = surface(
            self.camera, self.hits, self.mesh.vertices, self.mesh.normals, self.mesh.triangles
        )

        def bent(image: np.ndarray) -> Any:
            rows = np.ascontiguousarray(image.reshape(-1, 3)[self.pixel].T)
            return dr.normalize(normal + mi.Vector3f(rows))

        self.points = ShadingPoints(
            position,
            bent(self.maps.diffuse_perturbation()),
            bent(self.maps.perturbation),
            geometric,
            mi.Float(self.maps.roughness.ravel()[self.pixel]),
        )
        facing = np.zeros(size * size)
        facing[self.pixel] = dr.dot(geometric, self.points.to_viewer).numpy()
        landmarks = default_model().landmarks(vertices)
        seen = self.camera.project(landmarks[np.isfinite(landmarks).all(axis=1)])
        hull = cv2.convexHull(np.round(seen).astype(np.int32))
        face = cv2.fillConvexPoly(np.zeros((size, size), np.uint8), hull, 1)
        inside = (facing.reshape(size, size) > 0.2) & (face > 0)
        self.inside = np.asarray(ndimage.binary_erosion(inside, iterations=4), bool)

    def render(self, maps: Maps, environment: np.ndarray, bounces: int) -> np.ndarray:
        cells = refine(grid_cells(), environment)
        quadrature, radiance = Quadrature(cells), cells.average(environment)
        bits = visibility(self.mesh.scene, self.points, quadrature)
        e, s = shade(self.points, quadrature, bits, radiance)
        interreflection = Interreflection(
            self.mesh, self.camera, self.hits, maps.roughness, bounces
        )
        more_e, more_s = interreflection.under(quadrature).shade(radiance, maps)
        return image_from_shading(
            maps, self.pixel, e.numpy()[:, None] + more_e, s.numpy()[:, None] + more_s
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=512, help="pixels on a side")
    parser.add_argument("--samples", type=int, default=512, help="reference, per pixel")
    parser.add_argument(
        "--hdri", type=Path, help="panorama for the SG fit; a made-up sky if absent"
    )
    parser.add_argument("--bounces", type=int, default=3)
    parser.add_argument("--images", type=Path, help="folder for renders and differences as PNG")
    parser.add_argument("--quick", action="store_true", help="96 pixels, 128 samples")
    options = parser.parse_args()
    size, samples = (96, 128) if options.quick else (options.size, options.samples)
    side = np.radians(65)
    lights = {
        "uniform": uniform(),
        "frontal small": flash(),
        "side, hard shadow": disc((np.sin(side), 0.15, np.cos(side))),
        "SG fit of an HDRI": gaussians_of(panorama(options.hdri)).rasterize(),
    }
    head = Head(size)
    print(f"{size} x {size}, {samples} samples per pixel, {head.inside.sum()} face pixels")
    print(
        f"{'light':20s}{'paths':>12s}{'mean':>8s}{'bias':>8s}{'p95':>8s}{'noise':>8s}"
        f"{'ours s':>9s}{'Mitsuba s':>11s}"
    )
    for name, environment in lights.items():
        for bounces in (0, options.bounces):
            begin = time.perf_counter()
            ours = head.render(head.maps, environment, bounces)
            middle = time.perf_counter()
            halves = [
                path_trace(head.mesh, head.camera, head.maps, environment, samples // 2, bounces, k)
                for k in (1, 2)
            ]
            end = time.perf_counter()
            a, b, first, second = (
                ndimage.uniform_filter(x, 5, axes=(0, 1))[head.inside].mean(axis=1)
                for x in (ours, (halves[0] + halves[1]) / 2, *halves)
            )
            error = np.abs(a - b)
            relative = error / np.maximum(b, 0.1 * b.mean())
            kind = "direct" if bounces == 0 else f"{bounces} bounces"
            row = (
                error.mean() / b.mean(),
                a.mean() / b.mean() - 1,
                np.percentile(relative, 95),
                np.abs(first - second).mean() / b.mean() / 2,
            )
            print(
                f"{name:20s}{kind:>12s}{100 * row[0]:8.3f}{100 * row[1]:+8.3f}{100 * row[2]:8.3f}"
                f"{100 * row[3]:8.3f}{middle - begin:9.2f}{end - middle:11.1f}",
                flush=True,
            )
            if options.images:
                options.images.mkdir(parents=True, exist_ok=True)
                reference = (halves[0] + halves[1]) / 2
                shown = [np.maximum(x, 0) ** (1 / 2.2) for x in (reference, ours)]
                shown += [0.5 + 10 * (ours - reference)]
                strip = (np.clip(np.hstack(shown), 0, 1)[..., ::-1] * 255).astype(np.uint8)
                cv2.imwrite(str(options.images / f"{name.replace(' ', '_')}_{bounces}.png"), strip)


if __name__ == "__main__":
    main()
