"""Whole heads, with hair and clothes, relit over their photo and held against path-traced truth.

    python benchmarks/portrait.py --work DIR [--only TEXT] [--sheet FILE.png]

Each head is path-traced under an old light and photographed, reconstructed and relit from the
command line; the truth is the same head path-traced under the new light. Renderings and
reconstructions are kept in DIR; what is relit is made anew. The person is all that is no background
in truth. PSNR: of sRGB-encoded values over the person, one gain, the truth scaled so that its 95th
percentile of luminance is 0.5. Border: RMS error in a band across the rim of the skin's mask, where
it lies on the person, over that inside the mask beside the band.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

import unlit  # before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import snapshots
import strands
import worn
from dressed import HAIR, Dressed, Look, Scene, View
from heads import random_head
from masks import content_of
from painting import SKINS

from unlit.color import encode_srgb, luminance
from unlit.evaluate.metrics import best_gain, psnr
from unlit.output.images import png
from unlit.perception.parser import CLASSES
from unlit.relighting.lights import environment_map
from unlit.storage.keys import key
from unlit.storage.pictures import read_picture

SIZE = 512  # of the picture, pixels
SAMPLES = 48
#: Half the width of the band across the rim of the mask, of the square root of its area.
BAND = 0.04
#: By name: style of the hair, its colour, beard, skin, turn of the head, old light.
HEADS = {
    "short": ("short", "brown", None, "light", -12.0, "window"),
    "bob": ("bob", "blond", None, "medium", 15.0, "above"),
    "beard": ("curly", "black", "full", "dark", 0.0, "side"),
}
LIGHTS = ("flash", "sun:-50,30", "uniform")


def scene(name: str) -> Scene:
    """A head of HEADS before its camera."""
    style, colour, beard, tone, yaw, _ = HEADS[name]
    rng = np.random.default_rng(50 + list(HEADS).index(name))
    head = random_head(rng)
    skin = np.array(SKINS[tone])
    grown = {"hair": [strands.hair(head, strands.STYLES[style], rng)]}
    if beard:
        grown |= strands.beard(head, beard, rng)
    grown["eyebrows"] = [strands.brows(head, rng)]
    hair = HAIR[colour]
    look = Look(tuple(skin), tuple(skin * (0.9, 0.55, 0.6)), hair=hair, brow=hair, beard=hair)
    view = View(yaw, distance=120.0, width=46.0)
    return Scene(Dressed(head, look, grown, worn.garment(head, rng)), view, SIZE)


def rendering(work: Path, name: str, light: str) -> tuple[np.ndarray, np.ndarray]:
    """(S, S, 4) linear with coverage, and the shares (S, S, C) of the truth."""
    environment = snapshots.LIGHTS[light]() if light in snapshots.LIGHTS else environment_map(light)
    if environment.ndim == 2:
        environment = np.repeat(environment[..., None], 3, axis=2)
    built = scene(name)
    this = key(content_of(built, SIZE, SAMPLES), environment)[:12]
    file = work / f"{name}-{light.replace(':', '-')}-{this}.npz"
    if not file.exists():
        np.savez_compressed(file, image=built.photograph(environment, SAMPLES), shares=built.shares)
    with np.load(file) as data:
        return data["image"], data["shares"]


def photograph(render: np.ndarray, seed: int) -> np.ndarray:
    """(S, S, 3) uint8: a background, an exposure that looks at the head, noise and JPEG."""
    rng = np.random.default_rng(seed)
    covered = render[..., 3:]
    level = np.percentile(luminance(render[..., :3])[covered[..., 0] > 0.9], 95)
    linear = render[..., :3] * (0.5 / level) + (1 - covered) * snapshots.background(SIZE, rng)
    linear = linear + rng.standard_normal(linear.shape) * 0.002 * np.sqrt(np.maximum(linear, 0.01))
    return snapshots.jpeg(encode_srgb(np.clip(linear, 0, 1).astype(np.float32)), 95)


def result(work: Path, name: str) -> tuple[Path, Path]:
    """Its photo, and the folder of the reconstruction."""
    number = list(HEADS).index(name)
    photo, folder = work / f"{name}.png", work / f"{name}-result"
    picture = png(photograph(rendering(work, name, HEADS[name][-1])[0], number))
    if not photo.exists() or photo.read_bytes() != picture or not folder.exists():
        photo.write_bytes(picture)
        _unlit("reconstruct", photo, "-o", folder, "--preset", "draft", "--set", "resolution=384")
    return photo, folder


def _unlit(*arguments: object) -> None:
    subprocess.run(
        [sys.executable, "-m", "unlit", *map(str, arguments)],
        check=True,
        env=os.environ,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def relit(work: Path, name: str, light: str) -> np.ndarray:
    """(S, S, 3) linear: what `unlit relight` makes of the photo."""
    photo, folder = result(work, name)
    out = work / f"{name}-{light.replace(':', '-')}.exr"
    _unlit("relight", folder, "--light", light, "--over-photo", photo, "-o", out, "--fast")
    return read_picture(out)


def rim(work: Path, name: str, person: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S, S) bool each: the band across the rim of the skin's mask, and what is deeper inside."""
    r = unlit.load(result(work, name)[1])
    empty = np.zeros((SIZE, SIZE, 1), np.float32)
    mask = r.photo.crop.paste(r.face.mask[..., None], empty, np.ones_like(r.face.mask))
    skin = mask[..., 0] > 0.5
    reach = BAND * np.sqrt(skin.sum())
    within, beyond = (np.asarray(ndimage.distance_transform_edt(s)) for s in (skin, ~skin))
    return person & (np.maximum(within, beyond) <= reach), person & (within > reach)


def score(
    found: np.ndarray, truth: np.ndarray, masks: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[float, float, float]:
    """PSNR over the person, dB, and RMS errors of encoded values in the band and inside.

    masks: the person, the band, and the inside, (S, S) bool.
    """
    person, band, inside = masks
    found = found * best_gain(found, truth, person)
    squared = np.clip(encode_srgb(found), 0, 1) - np.clip(encode_srgb(truth), 0, 1)
    squared = (squared**2).mean(axis=2)
    return (
        psnr(found, truth, person),
        float(np.sqrt(squared[band].mean())),
        float(np.sqrt(squared[inside].mean())),
    )


def main() -> None:
    """Render and reconstruct what is missing, then the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--work", type=Path, required=True, help="folder of what is kept")
    parser.add_argument("--only", default="", help="heads whose name has this in it")
    parser.add_argument("--sheet", type=Path, help="also a picture: photo; relit and truth")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    every: list[tuple[float, float, float]] = []
    rows: list[np.ndarray] = []
    print("| head | old light | new light | PSNR, dB | band | inside | border |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for name in (name for name in HEADS if options.only in name):
        photo = np.asarray(cv2.imread(str(result(options.work, name)[0])))[..., ::-1]
        row = [photo]
        for light in LIGHTS:
            image, shares = rendering(options.work, name, light)
            person = shares[..., CLASSES.index("background")] < 0.5
            level = np.percentile(luminance(image[..., :3])[person], 95)
            truth = image[..., :3] * np.float32(0.5 / level)
            found = relit(options.work, name, light)
            masks = (person, *rim(options.work, name, person))
            each = score(found, truth, masks)
            every.append(each)
            _row(f"{name} | {HEADS[name][-1]} | {light}", each)
            shown = (found * best_gain(found, truth, person), truth)
            row += [np.round(255 * np.clip(encode_srgb(x), 0, 1)).astype(np.uint8) for x in shown]
        rows.append(np.hstack(row))
    _row("mean | | ", tuple(np.mean(every, axis=0)))
    if options.sheet:
        cv2.imwrite(str(options.sheet), np.vstack(rows)[..., ::-1])


def _row(title: str, each: tuple[float, ...]) -> None:
    psnr_, band, inside = each
    print(
        f"| {title} | {psnr_:.1f} | {band:.3f} | {inside:.3f} | {band / inside:.2f} |", flush=True
    )


if __name__ == "__main__":
    main()
