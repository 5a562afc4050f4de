"""Path-trace the heads that tools/train_parser.py learns from; no photo of a person is behind them.

    python tools/parser_heads.py DIR [--first N] [--count N]

Shapes of the default head model with random expressions; random skin, hair, brows, beards, glasses,
hats, scarves, hands and lights (benchmarks/strands.py, worn.py, dressed.py). DIR/N.npz holds of one
head: renders (L, S, S, 4) float16, linear radiance under L lights and coverage; shares (S, S, C)
uint8 of perception/parser.py, 255 is all; landmarks (478, 3), pixels, where they truly are.
What a camera makes of a render, and the background, are drawn anew whenever it is looked at.
"""

from __future__ import annotations

import argparse
import gc
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import snapshots
import strands
import worn
from dressed import HAIR, Dressed, Look, Scene, View
from heads import EXPRESSIONS, random_head
from strands import Strands

SIZE = 224
SAMPLES = 16
LIGHTS = 2
_HAIR = np.array(list(HAIR.values()))
#: Hair over the forehead is what is most easily taken for skin: it comes more often.
_STYLES = [*strands.STYLES, *(("fringe", "short fringe") * 2), *(("side fringe",) * 5)]


def random_look(rng: np.random.Generator) -> Look:
    """Skin of any tone, hair of any colour, lips with and without lipstick."""
    tone = np.exp(rng.uniform(np.log(0.05), np.log(0.68)))
    skin = tone * np.array([1.0, 0.45 + 0.32 * tone, 0.3 + 0.42 * tone])
    skin = skin * np.exp(rng.normal(0, (0.04, 0.07, 0.10)))
    lips = skin * np.exp(rng.normal((-0.1, -0.45, -0.4), (0.1, 0.2, 0.2)))
    if rng.random() < 0.2:
        lips = np.exp(rng.uniform(np.log(0.15), np.log(0.6))) * np.array(
            [1.0, rng.uniform(0.03, 0.5), rng.uniform(0.05, 0.6)]
        )
    hair = _HAIR[rng.integers(len(_HAIR))] * np.exp(rng.normal(0, 0.25, 3) * (1, 0.4, 0.4))
    if rng.random() < 0.04:
        hair = rng.uniform(0.02, 0.5, 3)  # dyed
    brow = hair * rng.uniform(0.35, 1.1)
    beard = hair if rng.random() < 0.5 else _HAIR[rng.integers(len(_HAIR))]
    iris = np.array([(0.05, 0.03, 0.015), (0.10, 0.16, 0.22), (0.09, 0.12, 0.06)])[rng.integers(3)]

    def rgb(colour: np.ndarray) -> tuple[float, float, float]:
        red, green, blue = (float(c) for c in np.clip(colour, 0.004, 0.8))
        return red, green, blue

    rough = float(rng.uniform(0.25, 0.6))
    return Look(rgb(skin), rgb(lips), rgb(iris), rgb(hair), rgb(brow), rgb(beard), rough)


def random_scene(rng: np.random.Generator) -> Scene:
    """Someone, with whatever people wear, before the camera."""
    head = random_head(rng, str(rng.choice(list(EXPRESSIONS))), spread=rng.uniform(0.5, 1.1))
    look = random_look(rng)
    grown: dict[str, list[Strands]] = {"hair": [], "eyebrows": []}
    pieces = list(worn.garment(head, rng))
    hats = worn.hat(head, rng) if rng.random() < 0.16 else []
    if rng.random() < 0.92:
        style = strands.STYLES[str(rng.choice(_STYLES))]
        grown["hair"].append(strands.hair(head, style, rng))
        if rng.random() < 0.15:
            grown["hair"].append(strands.loose_strands(head, rng))
    if rng.random() < 0.95:
        grown["eyebrows"].append(strands.brows(head, rng))
    if rng.random() < 0.4:
        kind = str(rng.choice(list(strands.BEARDS)))
        grown |= strands.beard(head, kind, rng)
    if rng.random() < 0.28:
        pieces += worn.glasses(head, rng)
    if rng.random() < 0.10:
        pieces += worn.scarf(head, rng)
    if rng.random() < 0.16:
        pieces += worn.hand(head, rng, look.skin)
    clothes = [piece.vertices for piece in hats]
    grown["hair"] = [strands.below(hair, clothes) for hair in grown["hair"]]
    view = View(
        float(np.clip(rng.normal(0, 20), -55, 55)),
        float(rng.normal(0, 9)),
        float(rng.normal(0, 8)),
        float(np.exp(rng.uniform(np.log(45), np.log(200)))),
        float(rng.uniform(29, 35)),
    )
    seed = int(rng.integers(1 << 31))
    return Scene(Dressed(head, look, grown, [*pieces, *hats], seed), view, SIZE)


def main() -> None:
    """Render DIR/N.npz for all N of the range that are missing."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=2000)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    began, made = time.monotonic(), 0
    for number in range(options.first, options.first + options.count):
        file = options.folder / f"{number:05d}.npz"
        if file.exists():
            continue
        rng = np.random.default_rng(7_000_000 + number)
        scene = random_scene(rng)
        lights = [snapshots.random_light(rng) for _ in range(LIGHTS)]
        renders = np.stack([scene.photograph(x, SAMPLES, k) for k, x in enumerate(lights)])
        part = file.with_suffix(".part.npz")
        np.savez_compressed(
            part,
            renders=np.minimum(renders, 6e4).astype(np.float16),
            shares=np.round(255 * scene.shares).astype(np.uint8),
            landmarks=scene.landmarks().astype(np.float32),
        )
        part.rename(file)
        del scene  # what is still registered with Dr.Jit changes the next one's kernels
        gc.collect()
        made += 1
        pace = (time.monotonic() - began) / made
        print(f"\r{number}: {pace:.1f} s each", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
