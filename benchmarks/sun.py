"""How well faces under sun and sky are delit, on heads of known truth.

    python benchmarks/sun.py [--subjects LIST] [--cases LIST] [--true-mesh] [--quick] -o DIR

Every head is path-traced under Mitsuba's sun and sky and the ground that they light. Cases:
`45-90`, the sun 45 degrees high (20, 45, 70) and 90 beside the camera (0, 45, 90); `brim`,
`strands`, `frames`, `leaves`: that between sun and face, 45-45; `clip-2`, `clip-10`: a hard flash
with so many percent of the face beyond white, and `clip-0`. Then comes a camera: white balance
20 % off, a tone curve with a shoulder, noise, 8 bits, JPEG 90. The reconstruction (`draft`) takes
the light for white. It has the camera's focal length, and the true mesh with --true-mesh.

Per photo: PSNR of the albedo (dB, sRGB, inside the face) after one gain, and after one for each
channel; relit by uniform light and by a flash, after one gain; `edges`: the gradient of the
albedo's log error along the true edges of the sun's shadow over that elsewhere, 1 where nothing is
seen of them; `detail`: correlation of the albedo's fine scales with the truth's in the sun's
shadow, where the photo has 12 of 255 or more; seconds. DIR gets sun.md, sun.json, and a picture of
each: photo, albedo, true albedo, the sun's true visibility.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from subjects import SHARED, ict, lee_perry_smith, own

import unlit

# isort: split
import occluders
from snapshots import jpeg

from unlit.color import encode_srgb
from unlit.evaluate.command import light
from unlit.evaluate.metrics import best_gain, channel_gains, psnr
from unlit.evaluate.protocol import exposure
from unlit.evaluate.table import Table, markdown
from unlit.evaluate.truth import KnownSubject
from unlit.head.sources.library import default_model
from unlit.machine.runtime import mitsuba
from unlit.optimize.run_record import RunRecord
from unlit.output.images import bytes_of, encoded, png
from unlit.perception.landmarks import choose, find_faces
from unlit.photo.photo import Photo
from unlit.pipeline.chain import fitting, known_mesh, run_chain, steps_of
from unlit.render.reference import trace
from unlit.render.relighter import Relighter
from unlit.scene.arrays import device
from unlit.scene.light import RASTER, disc, latlong_directions, latlong_solid_angles
from unlit.settings.settings import PRESETS
from unlit.storage.folder import write_one

mi = mitsuba()

SIZE = 256
SAMPLES = 64
SETTINGS = replace(PRESETS["draft"], resolution=SIZE)
POSITIONS = tuple(f"{high}-{beside}" for high in (20, 45, 70) for beside in (0, 45, 90))
CLIPPED = ("clip-0", "clip-2", "clip-10")
CASES = (*POSITIONS, *occluders.KINDS, *CLIPPED)
QUICK = ("45-45", "brim")
_COVERED = (45.0, 45.0)
_TURBIDITY, _GROUND = 3.0, 0.2
_SUN = 0.27  # half of what it subtends, degrees
_BLACK = 12 / 255


@dataclass(frozen=True)
class Sky:
    """Environment maps (180, 360, 3) in the camera's frame, and the sun's direction (3,)."""

    sun: np.ndarray
    rest: np.ndarray
    direction: np.ndarray


def sun_and_sky(high: float, beside: float) -> Sky:
    """By Mitsuba's `sunsky`; the ground is grey, and lit by both."""
    a, b = np.radians((high, beside))
    direction = np.array([np.sin(b) * np.cos(a), np.sin(a), np.cos(b) * np.cos(a)])
    swapped = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # the emitter's up is z

    def map_of(height: int, **more: float) -> np.ndarray:
        directions = latlong_directions(height, 2 * height).reshape(-1, 3) @ swapped.T
        emitter = mi.load_dict(
            {
                "type": "sunsky",
                "sun_direction": (swapped @ direction).tolist(),
                "turbidity": _TURBIDITY,
                "sun_aperture": 10.0,  # wide enough for a map; its irradiance stays
                **more,
            }
        )
        si: Any = mi.SurfaceInteraction3f()
        si.wi = device(mi.Vector3f, -directions)
        return emitter.eval(si).numpy().T.reshape(height, 2 * height, 3)

    height, width = RASTER
    rest = np.array(map_of(height, sun_scale=0.0))
    up = latlong_directions(height, width)[..., 1]
    area = latlong_solid_angles(height, width)[..., None]
    fine = map_of(4 * height, sky_scale=0.0)
    facing = np.maximum(latlong_directions(4 * height, 4 * width) @ direction, 0)[..., None]
    flux = (fine * facing * latlong_solid_angles(4 * height, 4 * width)[..., None]).sum(axis=(0, 1))
    sun = disc(direction, half_angle=_SUN)[..., None] * (flux / np.pi).astype(np.float32)
    rest[up <= 0] = 0
    on_ground = (rest * np.maximum(up, 0)[..., None] * area).sum(axis=(0, 1)) + flux * direction[1]
    rest[up <= 0] = _GROUND * on_ground / np.pi
    scale = np.float32(1 / (flux[1] / np.pi))
    return Sky(sun * scale, (rest * scale).astype(np.float32), direction)


@dataclass(frozen=True)
class Shot:
    """Linear (H, W, 3) before the camera; visibility: (H, W) of the sun, NaN where it is not
    faced or there is none.
    """

    image: np.ndarray
    visibility: np.ndarray


class Sitter:
    """A subject, where its features are, and what is asked of its reconstructions."""

    def __init__(self, name: str, subject: KnownSubject) -> None:
        self.name, self.subject = name, subject
        self.white = {x: light(x).environment for x in ("uniform", "flash")}
        self.lit = {x: subject.photograph(e, SAMPLES) for x, e in self.white.items()}

    @cached_property
    def points(self) -> np.ndarray:
        """Landmarks (478, 3) on the surface, cm, camera's frame, as found under even light."""
        image, truth = self.lit["uniform"], self.subject.truth
        faces = find_faces(encoded(image * exposure(image, truth.seen)))
        found = choose(faces, "largest", self.name).landmarks[:, :2]
        column, row = np.clip(found, 0, SIZE - 1).astype(int).T
        return truth.position[row, column]

    def shot(self, case: str) -> Shot:
        """The subject in one of CASES."""
        subject, seen = self.subject, self.subject.truth.seen
        if case in CLIPPED:
            flash, share = self.lit["flash"], float(case.split("-")[1])
            gain = exposure(flash, seen)
            if share:
                gain = np.float32(1 / np.percentile(flash[seen].max(axis=1), 100 - share))
            return Shot(flash * gain, np.full(seen.shape, np.nan))
        kind = case if case in occluders.KINDS else None
        high, beside = _COVERED if kind else map(float, case.split("-"))
        sky = sun_and_sky(high, beside)
        more = occluders.KINDS[kind](self.points, sky.direction) if kind else {}
        bodies = subject.bodies | more
        image = trace(bodies, subject.camera, sky.sun + sky.rest, SAMPLES, 3, 0)
        faced = (subject.truth.normal @ sky.direction > 0.1) & seen
        visible = _open(bodies, subject.truth.position, sky.direction)
        visible = np.where(faced, visible, np.nan)
        return Shot(image * exposure(image, seen), visible)

    def figures(self, shot: Shot, true_mesh: bool) -> tuple[dict[str, float], np.ndarray]:
        """What the module's docstring names, and the picture."""
        truth = self.subject.truth
        picture = camera(shot.image)
        photo = Photo.of(picture, self.name)
        began = time.perf_counter()
        head = known_mesh(*self.subject.mesh()) if true_mesh else fitting(default_model())
        steps = steps_of(photo, head, camera=self.subject.camera)
        made = run_chain(steps, SETTINGS, RunRecord(lambda *_: None))
        seconds = time.perf_counter() - began
        face, regions = made.face, made.photo.regions
        mask = truth.seen & (face.mask > 0.5) & (regions.eyes < 0.3)
        albedo, true = face.maps.diffuse_albedo, truth.diffuse_albedo
        one = albedo * best_gain(albedo, true, mask)
        found = {
            "albedo": psnr(one, true, mask),
            "albedo, three gains": psnr(albedo * channel_gains(albedo, true, mask), true, mask),
        }
        relighter = Relighter(face)
        for name, environment in self.white.items():
            image = relighter(environment)
            gained = image * best_gain(image, self.lit[name], mask)
            found[name] = psnr(gained, self.lit[name], mask)
        found["edges"] = edges(one, true, shot.visibility, mask)
        found["detail"] = detail(one, true, shot.visibility, mask, picture)
        found["seconds"] = seconds
        shadow = np.repeat(np.nan_to_num(shot.visibility, nan=0.5)[..., None], 3, axis=2)
        panels = [picture / 255, *(encode_srgb(x * mask[..., None]) for x in (one, true)), shadow]
        return {name: round(float(x), 3) for name, x in found.items()}, bytes_of(np.hstack(panels))


def _open(bodies: dict[str, Any], position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(H, W) in [0, 1]: the share of the sun's disc that is seen from positions (H, W, 3)."""
    scene = mi.load_dict({"type": "scene", **bodies})
    rng = np.random.default_rng(0)
    total = np.zeros(position.shape[:2], np.float32)
    rays = 16
    for _ in range(rays):
        towards = direction + np.tan(np.radians(_SUN)) * rng.uniform(-1, 1, 3)
        towards /= np.linalg.norm(towards)
        start = position.reshape(-1, 3) + 0.05 * towards
        ray = mi.Ray3f(device(mi.Point3f, start), mi.Vector3f(*map(float, towards)))
        total += ~scene.ray_test(ray).numpy().reshape(total.shape)
    return total / rays


def camera(image: np.ndarray, seed: int = 0) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of linear `image`, as a telephone might store it."""
    rng = np.random.default_rng(seed)
    linear = image * np.array([1.1, 1.0, 0.92], np.float32)  # red over blue 20 % off
    linear = linear + rng.standard_normal(linear.shape) * 0.004 * np.sqrt(np.maximum(linear, 0.01))
    linear = np.clip(linear, 0, 1)  # the sensor is full
    knee = 0.7  # above it the curve bends
    over = np.maximum(linear - knee, 0) / (1 - knee)
    shoulder = np.minimum(linear, knee) + (1 - knee) * np.expm1(-over) / np.expm1(-1)
    curve = encode_srgb(shoulder.astype(np.float32))
    return jpeg(curve + 0.25 * (curve * curve * (3 - 2 * curve) - curve), 90)


def _log(image: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(image, 0.003)).mean(axis=2)


def edges(found: np.ndarray, true: np.ndarray, visible: np.ndarray, mask: np.ndarray) -> float:
    """How visible the edges of the sun's shadow are; NaN where there are none."""
    steep = ndimage.gaussian_gradient_magnitude(np.nan_to_num(visible, nan=0), 1.0)
    known: Any = ndimage.binary_erosion(np.isfinite(visible) & mask, iterations=3)
    beside: Any = ndimage.binary_dilation(known & (steep > 0.15), iterations=2) & known
    if beside.sum() < 30:
        return float("nan")
    error = np.where(mask, _log(found) - _log(true), 0)
    slope = ndimage.gaussian_gradient_magnitude(error, 1.0)
    around: Any = ndimage.binary_dilation(beside, iterations=3)
    far = known & ~around
    return float(slope[beside].mean() / max(float(slope[far].mean()), 1e-9))


def detail(
    found: np.ndarray, true: np.ndarray, visible: np.ndarray, mask: np.ndarray, photo: np.ndarray
) -> float:
    """Correlation of what is finer than 4 pixels, in shadow; NaN where there is little of it."""
    shaded = mask & (visible < 0.3) & (photo.min(axis=2) >= 255 * _BLACK)
    dark: Any = ndimage.binary_erosion(shaded, iterations=2)
    if dark.sum() < 100:
        return float("nan")
    fine = [x - ndimage.gaussian_filter(x, 4.0) for x in (_log(found), _log(true))]
    return float(np.corrcoef(fine[0][dark], fine[1][dark])[0, 1])


def sitters() -> dict[str, Callable[[], KnownSubject]]:
    """By name, how to make each head that this machine can make."""
    found: dict[str, Callable[[], KnownSubject]] = {"own-medium": lambda: own("medium", 12, SIZE)}
    if (SHARED / "data").is_dir():
        found |= {
            "ict-light": lambda: ict("light", 1, SIZE),
            "ict-medium": lambda: ict("medium", 2, SIZE),
            "ict-dark": lambda: ict("dark", 3, SIZE),
            "lee-perry-smith": lambda: lee_perry_smith(SIZE),
        }
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--subjects", help="comma-separated; default all there are")
    parser.add_argument("--cases", help="comma-separated; default all")
    parser.add_argument("--true-mesh", action="store_true", help="give each subject's own mesh")
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(QUICK)}")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    known = sitters()
    chosen = options.subjects.split(",") if options.subjects else list(known)
    cases = options.cases.split(",") if options.cases else QUICK if options.quick else CASES
    if unknown := (set(chosen) - set(known)) | (set(cases) - set(CASES)):
        parser.error(
            f"unknown: {', '.join(sorted(unknown))}; heads: {', '.join(known)}; "
            f"cases: {', '.join(CASES)}"
        )
    options.output.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, float]] = {}
    for name in chosen:
        sitter = Sitter(name, known[name]())
        for case in cases:
            row, sheet = sitter.figures(sitter.shot(case), options.true_mesh)
            found[f"{name} {case}"] = row
            write_one(options.output / f"{name}-{case}.png", png(sheet))
            write_one(options.output / "sun.json", (json.dumps(found, indent=1) + "\n").encode())
            print(name, case, row, file=sys.stderr, flush=True)
    heading = ("photo", *next(iter(found.values())))
    body = [(name, *(f"{x:.2f}" for x in row.values())) for name, row in found.items()]
    means = (f"{np.nanmean([row[x] for row in found.values()]):.2f}" for x in heading[1:])
    mesh = "true mesh" if options.true_mesh else "fitted mesh"
    facts = [f"unlit {unlit.__version__}, {SIZE} x {SIZE} pixels, preset draft, {mesh}"]
    text = markdown("Sun", facts, [Table("", heading, (*body, ("mean", *means)))])
    write_one(options.output / "sun.md", text.encode())
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
