"""Whether the specular map follows the truth, on heads whose gloss varies.

    python benchmarks/gloss.py [--subjects LIST] [--lights LIST] [--true-mesh] [--plain] -o DIR

ICT heads of three skins whose specular albedo and roughness vary over the face by some 40 and 12 %
at a scale of 2 cm, that of no region of a face; the same, oily: twice the gloss, finer, of
roughness 0.19; and the Lee Perry-Smith scan. Photos are path-traced, with noise and 8 bits; preset
`draft`. --plain: highlights are left in the diffuse albedo (`detail.highlight_most` 0).

Per photo, on plain skin: `level`, median of specular over diffuse albedo, over the truth's (which
no gain changes); `correlation` of ln specular albedo with the truth in blocks of an eighth of the
face; PSNR of the diffuse albedo after one gain, and of the render. DIR gets gloss.md, gloss.json
and a picture of each: photo, albedo, true albedo, specular albedo, the true one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from dim import camera
from scipy import ndimage
from subjects import SHARED, ict, lee_perry_smith

import unlit
from unlit.color import encode_srgb
from unlit.evaluate.command import light
from unlit.evaluate.metrics import best_gain, psnr
from unlit.evaluate.protocol import exposure
from unlit.evaluate.table import Table, markdown
from unlit.evaluate.truth import KnownSubject
from unlit.head.sources.library import default_model
from unlit.optimize.run_record import RunRecord
from unlit.output.images import bytes_of, png
from unlit.photo.photo import Photo
from unlit.pipeline.chain import fitting, known_mesh, run_chain, steps_of
from unlit.settings.settings import PRESETS, Settings
from unlit.storage.folder import write_one

SIZE = 256
_BLOCKS, _FEWEST = 8, 60
_SEEDS = {"light": 1, "medium": 2, "dark": 3}


def varied(skin: str, oily: bool) -> KnownSubject:
    """An ICT head whose gloss and roughness are those of no region of a face."""
    seed = _SEEDS[skin]

    def noise(sigma: float, number: int) -> np.ndarray:
        field = np.random.default_rng(100 * number + seed).standard_normal((SIZE, SIZE))
        field = ndimage.gaussian_filter(field, sigma * SIZE / 512, mode="wrap")
        return field / field.std()

    head = ict(skin, seed, SIZE)
    maps = head.maps
    specular = maps.specular_albedo * np.exp(0.35 * noise(45, 1))
    rough = maps.roughness * np.exp(0.12 * noise(45, 2))
    if oily:
        specular, rough = 2 * specular * np.exp(0.3 * noise(15, 3)), 0.62 * rough
    return replace(
        head,
        maps=replace(
            maps,
            specular_albedo=np.clip(specular, 0.05, 8).astype(np.float32),
            roughness=np.clip(rough, 0.1, 0.5).astype(np.float32),
        ),
    )


def subjects() -> dict[str, Callable[[], KnownSubject]]:
    """By name, how to make each."""
    heads: dict[str, Callable[[], KnownSubject]] = {
        f"{'oily ' if oily else ''}{skin}": partial(varied, skin, oily)
        for oily in (False, True)
        for skin in _SEEDS
    }
    return heads | {"scan": lambda: lee_perry_smith(SIZE)}


def blocks(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Means of (H, W) over blocks of an eighth of where (H, W) bool is; few pixels: NaN."""
    rows, columns = np.nonzero(inside)
    number = sum(
        scale * ((at - at.min()) * _BLOCKS // (np.ptp(at) + 1))
        for scale, at in ((_BLOCKS, rows), (1, columns))
    )
    count = np.bincount(number, minlength=_BLOCKS**2)
    total = np.bincount(number, values[inside], minlength=_BLOCKS**2)
    return np.where(count > _FEWEST, total / np.maximum(count, 1), np.nan)


def figures(
    subject: KnownSubject, image: np.ndarray, settings: Settings, true_mesh: bool
) -> tuple[dict[str, float], np.ndarray]:
    """What the module's docstring names, and the picture."""
    truth = subject.truth
    image = image * exposure(image, truth.seen)
    head = known_mesh(*subject.mesh()) if true_mesh else fitting(default_model())
    steps = steps_of(Photo.of(camera(image), subject.name), head, camera=subject.camera)
    made = run_chain(steps, settings, RunRecord(lambda *_: None))
    maps = made.face.maps
    mask = truth.seen & (made.face.mask > 0.5) & (made.photo.regions.eyes < 0.3)
    skin = mask & (made.photo.regions.skin > 0.9) & (truth.specular_albedo > 0)
    logs = [np.log(np.maximum(x, 0.01)) for x in (maps.specular_albedo, truth.specular_albedo)]
    here, there = (blocks(x, skin) for x in logs)
    known = np.isfinite(here)
    ratios = [
        np.median(s[skin] / np.maximum(d[skin].mean(axis=-1), 1e-3))
        for s, d in (
            (maps.specular_albedo, maps.diffuse_albedo),
            (truth.specular_albedo, truth.diffuse_albedo),
        )
    ]
    gain = best_gain(maps.diffuse_albedo, truth.diffuse_albedo, mask)
    albedo = maps.diffuse_albedo * gain
    found = {
        "level": ratios[0] / ratios[1],
        "correlation": np.corrcoef(here[known], there[known])[0, 1],
        "albedo": psnr(albedo, truth.diffuse_albedo, mask),
        "render": psnr(made.images.render, made.photo.image, mask),
    }
    top = np.percentile(truth.specular_albedo[skin], 99)
    glosses = (maps.specular_albedo * gain, truth.specular_albedo)
    panels = [
        *(encode_srgb(np.clip(x, 0, 1)) for x in (image, albedo, truth.diffuse_albedo)),
        *(np.repeat(np.clip(x / top, 0, 1)[..., None], 3, axis=-1) for x in glosses),
    ]
    return {k: float(v) for k, v in found.items()}, bytes_of(np.hstack(panels))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--subjects", help="comma-separated; default all")
    parser.add_argument("--lights", default="flash,side,uniform", help="comma-separated")
    parser.add_argument("--true-mesh", action="store_true", help="give each subject's own mesh")
    parser.add_argument("--plain", action="store_true", help="leave highlights in the albedo")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    if not (SHARED / "data").is_dir():
        parser.error("this benchmark needs the licensed test data beside the checkout")
    known = subjects()
    chosen = options.subjects.split(",") if options.subjects else list(known)
    if unknown := set(chosen) - set(known):
        parser.error(f"no such subject: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    options.output.mkdir(parents=True, exist_ok=True)
    settings = replace(PRESETS["draft"], resolution=SIZE)
    if options.plain:
        settings = replace(settings, detail=replace(settings.detail, highlight_most=0.0))
    found: dict[str, dict[str, float]] = {}
    for label in chosen:
        subject = known[label]()
        for name in options.lights.split(","):
            image = subject.photograph(light(name).environment, 64)
            row, sheet = figures(subject, image, settings, options.true_mesh)
            case = f"{label}, {name}"
            found[case] = {key: round(value, 3) for key, value in row.items()}
            write_one(options.output / f"{label.replace(' ', '-')}-{name}.png", png(sheet))
            write_one(options.output / "gloss.json", (json.dumps(found, indent=1) + "\n").encode())
            print(case, found[case], file=sys.stderr, flush=True)
    heading = ("photo", *next(iter(found.values())))
    body = tuple((case, *(f"{x:.2f}" for x in row.values())) for case, row in found.items())
    mesh = "true mesh" if options.true_mesh else "fitted mesh"
    left = ", highlights left in the albedo" if options.plain else ""
    facts = [f"unlit {unlit.__version__}, {SIZE} pixels, preset draft, {mesh}{left}"]
    text = markdown("Gloss", facts, [Table("", heading, body)])
    write_one(options.output / "gloss.md", text.encode())
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
