"""Whether the photo's finest detail is in the maps, on heads of known relief and pigment.

    python benchmarks/detail.py [--subjects LIST] [--lights LIST] [--true-mesh] [--size N] -o DIR

`pores` is an ICT head with a fine relief and no freckles, `freckles` the same head smooth and
freckled, `scan` the Lee Perry-Smith scan with its normal map. Photos are rendered without noise
(`Relighter`), but the scan's, which is path-traced; then come a little noise and 8 bits. Preset
`standard`.

Per photo, on well-lit skin: `octave`, contrast of what is finer than a pixel, of the albedo and of
the render, over the photo's; `relief`: correlation of the fine part (8 pixels of 512) of the
specular normal with the truth, the mesh's own left out, and its amplitude over the truth's;
`energy`: mean square of the fine part over that of `pores` in the same light; mean error of the
normals, degrees, and of the plain mesh; PSNR of the albedo after one gain, and of the render. DIR
gets detail.md and a picture of each: photo, albedo, true albedo, normals, true normals.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from subjects import SHARED, ict, lee_perry_smith

import unlit
from unlit.color import encode_srgb, luminance
from unlit.evaluate.command import light
from unlit.evaluate.metrics import angle, best_gain, psnr
from unlit.evaluate.protocol import exposure
from unlit.evaluate.table import Table, markdown
from unlit.evaluate.truth import KnownSubject, visible_surface
from unlit.face.face import Face, Normals, PosedMesh
from unlit.head.sources.library import default_model
from unlit.optimize.run_record import RunRecord
from unlit.output.images import bytes_of, encoded, png
from unlit.photo.photo import Photo
from unlit.pipeline.chain import fitting, known_mesh, run_chain, steps_of
from unlit.render.relighter import Relighter
from unlit.settings.settings import PRESETS
from unlit.storage.folder import write_one

_FINE = 8.0  # pixels of 512
_NOISE = 0.002
_MOST = (16, 84)  # percentiles between which contrasts are taken: few pixels do not decide


def subjects(size: int) -> dict[str, KnownSubject]:
    """By name; `pores` first, which the energy of the others is measured by."""
    plain = ict("light", 1, size, freckles=150)
    smooth = replace(plain.maps, perturbation=0 * plain.maps.perturbation)
    return {
        "pores": ict("light", 1, size, freckles=0),
        "freckles": replace(plain, maps=smooth),
        "scan": lee_perry_smith(size),
    }


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-6), np.float32)


def photograph(subject: Any, environment: np.ndarray) -> np.ndarray:
    """Linear (H, W, 3), as a camera stores it."""
    if hasattr(subject, "maps"):
        (vertices, triangles), maps = subject.mesh(), subject.maps
        plain = visible_surface(vertices, triangles, subject.camera)[1]
        there = (plain != 0).any(axis=-1, keepdims=True)
        normals = Normals(
            specular=_unit(plain + there * maps.perturbation),
            diffuse=_unit(plain + there * maps.diffuse_perturbation()),
        )
        uv = np.zeros((1, 2), np.float32)
        posed = PosedMesh(vertices, triangles, uv, np.zeros_like(triangles))
        inside = there[..., 0].astype(np.float32)
        face = Face(subject.camera, posed, maps, normals, inside)
        image = Relighter(face)(environment)
    else:
        image = subject.photograph(environment, 256)
    image = image * exposure(image, subject.truth.seen)
    grain = np.random.default_rng(0).standard_normal(image.shape)
    return np.maximum(image + _NOISE * np.sqrt(np.maximum(image, 0.01)) * grain, 0)


def fine(values: np.ndarray, inside: np.ndarray, sigma: float) -> np.ndarray:
    """(H, W) without what is coarser than `sigma` pixels; 0 outside."""
    share: Any = ndimage.gaussian_filter(inside.astype(np.float32), sigma)
    mean: Any = ndimage.gaussian_filter(np.where(inside, values, 0).astype(np.float32), sigma)
    return np.where(inside, values - mean / np.maximum(share, 1e-3), 0)


def figures(
    subject: KnownSubject, image: np.ndarray, true_mesh: bool
) -> tuple[dict[str, float], np.ndarray]:
    """What the module's docstring names (energy in absolute terms), and the picture."""
    truth, size = subject.truth, len(image)
    settings = replace(PRESETS["standard"], resolution=size)
    head = known_mesh(*subject.mesh()) if true_mesh else fitting(default_model())
    steps = steps_of(Photo.of(encoded(image), subject.name), head, camera=subject.camera)
    made = run_chain(steps, settings, RunRecord(lambda *_: None))
    face, e = made.face, luminance(made.images.diffuse_shading)
    skin: Any = truth.seen & (face.mask > 0.5) & (made.photo.regions.skin > 0.9)
    skin &= (e > 0.3 * np.percentile(e[face.mask > 0.5], 99)) & (image.max(axis=2) < 0.95)
    skin = ndimage.binary_erosion(skin, iterations=3)
    logs = [
        np.ptp(np.percentile(fine(np.log(np.maximum(luminance(x), 1e-4)), skin, 1.0)[skin], _MOST))
        for x in (made.photo.image, face.maps.diffuse_albedo, made.images.render)
    ]
    sigma = _FINE * size / 512
    plain = visible_surface(face.mesh.vertices, face.mesh.triangles, face.camera)[1]
    true_plain = visible_surface(*subject.mesh(), subject.camera)[1]
    bends = [
        np.stack([fine((a - b)[..., k], skin, sigma)[skin] for k in (0, 1)])
        for a, b in ((face.normals.specular, plain), (truth.normal, true_plain))
    ]
    energy, true_energy = (float((x**2).mean()) for x in bends)
    together, rough = float((bends[0] * bends[1]).mean()), true_energy > 1e-8
    mask = truth.seen & (face.mask > 0.5) & (made.photo.regions.eyes < 0.3)
    albedo = face.maps.diffuse_albedo
    albedo = albedo * best_gain(albedo, truth.diffuse_albedo, mask)
    found = {
        "octave, albedo": logs[1] / logs[0],
        "octave, render": logs[2] / logs[0],
        "relief": together / np.sqrt(energy * true_energy) if rough else np.nan,
        "amplitude": np.sqrt(energy / true_energy) if rough else np.nan,
        "energy": energy,
        "normals": angle(face.normals.specular, truth.normal, mask),
        "mesh": angle(plain, truth.normal, mask),
        "albedo": psnr(albedo, truth.diffuse_albedo, mask),
        "render": psnr(made.images.render, made.photo.image, mask),
    }
    panels = [
        *(encode_srgb(np.clip(x, 0, 1)) for x in (image, albedo, truth.diffuse_albedo)),
        *(0.5 + 0.5 * x for x in (face.normals.specular, truth.normal)),
    ]
    return {k: float(v) for k, v in found.items()}, bytes_of(np.hstack(panels))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--subjects", help="comma-separated; default all there are")
    parser.add_argument("--lights", default="flash,side,uniform", help="comma-separated")
    parser.add_argument("--true-mesh", action="store_true", help="give each subject's own mesh")
    parser.add_argument("--size", type=int, default=512, help="pixels (default: 512)")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    if not (SHARED / "data").is_dir():
        parser.error("this benchmark needs the licensed test data beside the checkout")
    options.output.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, float]] = {}
    known, bumps = subjects(options.size), float("nan")
    chosen = options.subjects.split(",") if options.subjects else list(known)
    if unknown := set(chosen) - set(known):
        parser.error(f"no such subject: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    for name in options.lights.split(","):
        for label in chosen:
            subject = known[label]
            image = photograph(subject, light(name).environment)
            row, sheet = figures(subject, image, options.true_mesh)
            bumps = row["energy"] if label == "pores" else bumps
            row["energy"] /= bumps
            case = f"{label} {name}"
            found[case] = {key: round(value, 3) for key, value in row.items()}
            write_one(options.output / f"{label}-{name}.png", png(sheet))
            write_one(options.output / "detail.json", (json.dumps(found, indent=1) + "\n").encode())
            print(case, found[case], file=sys.stderr, flush=True)
    heading = ("photo", *next(iter(found.values())))
    body = tuple((case, *(f"{x:.2f}" for x in row.values())) for case, row in found.items())
    mesh = "true mesh" if options.true_mesh else "fitted mesh"
    facts = [f"unlit {unlit.__version__}, {options.size} pixels, preset standard, {mesh}"]
    text = markdown("Detail", facts, [Table("", heading, body)])
    write_one(options.output / "detail.md", text.encode())
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
