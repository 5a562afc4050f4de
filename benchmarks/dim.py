"""Colour and level of the albedo from dim and warm photos, on heads of known truth.

    python benchmarks/dim.py [--subjects LIST] [--light NAME] [--true-mesh] [--color HOW] -o DIR

Every head is path-traced under a lamp from the side, white or of 2,700 K, and photographed at the
usual exposure, at 1/4 and at 1/16 of it, with noise and 8 bits. The reconstruction (`draft`) takes
the light for white, finds its colour (auto), or is told it.

Per photo, on bare skin: the angle between the mean albedo and the true one (degrees in linear RGB);
`level`: found over true albedo, green; `gloss`: found over true specular albedo; PSNR of the albedo
after one gain. Per head and light, over the exposures: the largest level over the smallest.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from sun import sitters

import unlit
from unlit.conditions.illuminant import of_temperature
from unlit.evaluate.command import light
from unlit.evaluate.metrics import best_gain, psnr
from unlit.evaluate.protocol import exposure
from unlit.evaluate.table import Table, markdown
from unlit.evaluate.truth import KnownSubject
from unlit.head.sources.library import default_model
from unlit.optimize.run_record import RunRecord
from unlit.output.images import encoded
from unlit.photo.photo import Photo
from unlit.pipeline.chain import fitting, known_mesh, run_chain, steps_of
from unlit.settings.conditions import LightColorRequest
from unlit.settings.settings import PRESETS, Settings
from unlit.storage.folder import write_one

SIZE = 256
SETTINGS = replace(PRESETS["draft"], resolution=SIZE)
KELVIN = {"white": None, "2700 K": 2700.0}
EXPOSURES = (1.0, 1 / 4, 1 / 16)
_NOISE = 0.002  # of a full sensor, and that of its square root


def camera(image: np.ndarray, seed: int = 0) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of linear `image`."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(image.shape) * _NOISE * np.sqrt(1 + np.maximum(image, 0) * 4)
    return encoded(image + noise)


def figures(
    subject: KnownSubject, image: np.ndarray, settings: Settings, true_mesh: bool
) -> dict[str, float]:
    """Of one photo, linear (H, W, 3): what the module's docstring names."""
    truth = subject.truth
    head = known_mesh(*subject.mesh()) if true_mesh else fitting(default_model())
    steps = steps_of(Photo.of(camera(image), subject.name), head, camera=subject.camera)
    made = run_chain(steps, settings, RunRecord(lambda *_: None))
    face = made.face
    mask = truth.seen & (face.mask > 0.5) & (made.photo.regions.eyes < 0.3)
    skin = mask & (made.photo.regions.skin > 0.9)
    albedo, true = face.maps.diffuse_albedo, truth.diffuse_albedo
    mean, true_mean = albedo[skin].mean(axis=0), true[skin].mean(axis=0)
    gloss = face.maps.specular_albedo[skin].mean() / truth.specular_albedo[skin].mean()
    return {
        "angle": _angle(mean, true_mean),
        "level": float(mean[1] / true_mean[1]),
        "gloss": float(gloss),
        "albedo": psnr(albedo * best_gain(albedo, true, mask), true, mask),
    }


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    """Between colours (3,), degrees."""
    cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    return float(np.degrees(np.arccos(min(cosine, 1.0))))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = sitters()
    parser.add_argument("--subjects", help="comma-separated; default all there are")
    parser.add_argument("--light", default="side", help="as for `unlit relight` (default: side)")
    parser.add_argument("--true-mesh", action="store_true", help="give each subject's own mesh")
    parser.add_argument("--color", choices=("white", "auto", "told"), default="white")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    chosen = options.subjects.split(",") if options.subjects else list(known)
    if unknown := set(chosen) - set(known):
        parser.error(f"no such subject here: {', '.join(sorted(unknown))}; {', '.join(known)}")
    options.output.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, float]] = {}
    for name in chosen:
        subject = known[name]()
        usual = subject.photograph(light(options.light).environment, 128)
        usual = usual * exposure(usual, subject.truth.seen)
        for label, kelvin in KELVIN.items():
            color = np.ones(3) if kelvin is None else of_temperature(kelvin)
            asked = options.color
            if asked == "told":
                asked = "white" if kelvin is None else f"{kelvin:.0f}K"
            settings = replace(SETTINGS, light_color=LightColorRequest(asked))
            for share in EXPOSURES:
                row = figures(subject, usual * color * share, settings, options.true_mesh)
                case = f"{name} {label} 1/{1 / share:.0f}"
                found[case] = {key: round(value, 3) for key, value in row.items()}
                print(case, found[case], file=sys.stderr, flush=True)
                text = json.dumps(found, indent=1) + "\n"
                write_one(options.output / "dim.json", text.encode())
    heading = ("photo", *next(iter(found.values())))
    body = tuple((case, *(f"{x:.2f}" for x in row.values())) for case, row in found.items())
    spread = []
    for name in chosen:
        for label in KELVIN:
            levels = [r["level"] for case, r in found.items() if case.startswith(f"{name} {label}")]
            spread.append((name, label, f"{max(levels) / min(levels):.2f}"))
    mesh = "true mesh" if options.true_mesh else "fitted mesh"
    facts = [
        f"unlit {unlit.__version__}, {SIZE} x {SIZE} pixels, preset draft, {mesh}, "
        f"light: {options.light}, colour: {options.color}"
    ]
    tables = [
        Table("", heading, body),
        Table("", ("head", "light", "largest over smallest"), tuple(spread)),
    ]
    text = markdown("Dim photos", facts, tables)
    write_one(options.output / "dim.md", text.encode())
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
