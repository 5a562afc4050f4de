"""Masks on path-traced heads whose every pixel is known: hair, brows, beards, glasses, hats, hands.

    python benchmarks/masks.py --work DIR [--only TEXT] [--sheet FILE.png]

Three skins, four shapes of the head, four lights; then one head under six lights. Rendered
pictures are kept in DIR, so that only perception is measured again. What is compared is the skin
with the brows that grow on it, without lips and eyes: ears, neck and a bald scalp are skin.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from painting import SKINS
from scipy import ndimage

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import snapshots
import strands
import worn
from dressed import BOUNCES, HAIR, Dressed, Look, Scene, View
from heads import Head, random_head

from unlit.errors import FaceError
from unlit.perception.parser import CLASSES
from unlit.photo.photo import Photo
from unlit.pipeline.observe import observe
from unlit.storage.keys import key

SIZE = 512  # of the picture; the face's crop is some 400 of it
RESOLUTION = 512
SAMPLES = 24
Dress = Callable[[Head, np.random.Generator], tuple[dict[str, list[Any]], list[Any]]]


def _hair(style: str) -> Dress:
    def dress(head: Head, rng: np.random.Generator) -> tuple[dict[str, list[Any]], list[Any]]:
        return {"hair": [strands.hair(head, strands.STYLES[style], rng)]}, []

    return dress


def _beard(kind: str) -> Dress:
    def dress(head: Head, rng: np.random.Generator) -> tuple[dict[str, list[Any]], list[Any]]:
        hair = strands.hair(head, strands.STYLES["short"], rng)
        return {"hair": [hair]} | strands.beard(head, kind, rng), []

    return dress


def _loose(head: Head, rng: np.random.Generator) -> tuple[dict[str, list[Any]], list[Any]]:
    tied = strands.hair(head, strands.STYLES["tied"], rng)
    return {"hair": [tied, strands.loose_strands(head, rng)]}, []


def _worn(make: Callable[..., list[Any]], style: str = "short", **how: Any) -> Dress:
    def dress(head: Head, rng: np.random.Generator) -> tuple[dict[str, list[Any]], list[Any]]:
        hair = strands.hair(head, strands.STYLES[style], rng)
        pieces = make(head, rng, **how)
        if make is worn.hat:
            hair = strands.below(hair, [piece.vertices for piece in pieces])
        return {"hair": [hair]}, pieces

    return dress


#: What the heads of the benchmark have on; each is one head under the four lights.
CASES: dict[str, tuple[Dress, str]] = {
    "bald": (lambda head, rng: ({}, []), "brown"),
    "short hair": (_hair("short"), "black"),
    "white curls": (_hair("curly"), "white"),
    "blond fringe": (_hair("fringe"), "blond"),
    "short fringe": (_hair("short fringe"), "brown"),
    "loose strands": (_loose, "red"),
    "long over a cheek": (_hair("wavy"), "brown"),
    "short beard": (_beard("short"), "brown"),
    "full beard": (_beard("full"), "grey"),
    "stubble": (_beard("stubble"), "black"),
    "clear glasses": (_worn(worn.glasses, "bob", tint="clear"), "grey"),
    "tinted glasses": (_worn(worn.glasses, "swept", tint="tinted"), "black"),
    "hat": (_worn(worn.hat, "bob"), "brown"),
    "scarf": (_worn(worn.scarf, "long"), "black"),
    "hand": (_worn(worn.hand, "buzz", skin=SKINS["medium"]), "black"),
}
EXPRESSIONS = ("none", "smile", "talk", "laugh")


@dataclass(frozen=True)
class Cell:
    """One picture: uint8 sRGB (S, S, 3), and the truth's shares (S, S, C)."""

    name: str
    picture: np.ndarray
    shares: np.ndarray


def scene(case: str, number: int, hair: str | None = None, size: int = SIZE) -> Scene:
    """The head of a case, before its camera; number: which of the skins, shapes and turns.

    hair: of dressed.HAIR; None is the case's own. size: of the picture, pixels.
    """
    rng = np.random.default_rng(1000 + number)
    dress, usual = CASES[case]
    hair = hair or usual
    head = random_head(rng, EXPRESSIONS[number % 4])
    skin = np.array(list(SKINS.values())[number % 3])
    lips = skin * (0.9, 0.55, 0.6)
    colour = HAIR[hair]
    brow = tuple(np.minimum(np.array(colour) * rng.uniform(0.4, 1.0), 0.4))
    look = Look(tuple(skin), tuple(lips), hair=colour, brow=brow, beard=colour)
    grown, pieces = dress(head, rng)
    grown = grown | {"eyebrows": [strands.brows(head, rng)]}
    pieces = [*pieces, *worn.garment(head, rng)]
    view = View(rng.uniform(-30, 30), rng.uniform(-8, 8), rng.uniform(-6, 6), width=34.0)
    return Scene(Dressed(head, look, grown, pieces, number), view, size)


def cells(work: Path, only: str = "") -> Iterator[tuple[str, list[Cell]]]:
    """By case, its pictures; rendered where `work` has none yet."""
    for number, case in enumerate(CASES):
        if only in case:
            lights = list(snapshots.LIGHTS)[:4]
            yield case, _pictures(work, case, number, lights)
    if only in "same head":
        number = list(CASES).index("short hair")
        yield "same head", _pictures(work, "short hair", number, list(snapshots.LIGHTS))


def _pictures(work: Path, case: str, number: int, lights: list[str]) -> list[Cell]:
    found, built = [], scene(case, number)
    content = content_of(built, SIZE, SAMPLES)
    for light in lights:
        name = f"{case}, {light}"
        environment = snapshots.LIGHTS[light]()
        rng = np.random.default_rng(number)
        behind = snapshots.background(SIZE, rng)
        this = key(content, environment, behind)[:12]
        file = work / f"{name.replace(' ', '-').replace(',', '')}-{this}.npz"
        if not file.exists():
            render = built.photograph(environment, SAMPLES, number)
            picture = snapshots.developed(render, behind, rng)
            shares = np.round(255 * built.shares).astype(np.uint8)
            work.mkdir(parents=True, exist_ok=True)
            np.savez_compressed(file, picture=picture, shares=shares)
        with np.load(file) as data:
            found.append(Cell(name, data["picture"], data["shares"].astype(np.float32) / 255))
    return found


def content_of(built: Scene, size: int, samples: int) -> str:
    """A key of all that a picture of the scene shows, but for its light and background."""
    dressed = built.dressed
    head = key(dressed.head.vertices, vars(dressed.look), built.landmarks())
    grown = [s.points for kind in dressed.strands.values() for s in kind]
    return key(size, samples, BOUNCES, head, *grown, *(p.vertices for p in dressed.worn))


@dataclass(frozen=True)
class Seen:
    """In the crop's pixels: what perception says is skin, lips and eyes, and the truth, shares."""

    image: np.ndarray
    skin: np.ndarray
    true: np.ndarray
    shares: np.ndarray


def perceive(cell: Cell) -> Seen | None:
    """What the product's first step makes of a picture; None where it finds no face."""
    try:
        found = observe(Photo.of(cell.picture, cell.name), RESOLUTION, "largest")
    except FaceError:
        return None
    shares = found.crop.image(cell.shares)
    skin = found.regions.skin + found.regions.eyebrows
    return Seen(found.image, skin, share_of(shares, "skin", "eyebrows"), shares)


def share_of(shares: np.ndarray, *names: str) -> np.ndarray:
    """(S, S): the share of those classes together."""
    return shares[..., [CLASSES.index(name) for name in names]].sum(axis=-1)


def score(seen: Seen) -> dict[str, float]:
    """iou; lost and taken, as shares of the true skin; alpha, the error at the hair's border."""
    found, true = seen.skin > 0.5, seen.true > 0.5
    area = max(int(true.sum()), 1)
    result = {
        "iou": float((found & true).sum() / max((found | true).sum(), 1)),
        "lost": float((true & ~found).sum() / area),
        "taken": float((found & ~true).sum() / area),
    }
    hair = share_of(seen.shares, "hair") > 0.5
    reach = 15 * RESOLUTION / 1000
    near = (_distance_to(hair) < reach) & (_distance_to(~hair) < reach)
    near &= _distance_to(true) < reach
    if near.sum() > 100:
        result["alpha"] = float(np.abs(seen.skin - seen.true)[near].mean())
    return result


def _distance_to(mask: np.ndarray) -> np.ndarray:
    """(S, S): how far each pixel is from the mask, pixels."""
    return np.asarray(ndimage.distance_transform_edt(~mask))


def agreement(masks: list[np.ndarray]) -> float:
    """Intersection over union of all of them."""
    found = np.stack([mask > 0.5 for mask in masks])
    return float(found.all(axis=0).sum() / max(found.any(axis=0).sum(), 1))


def overlay(seen: Seen) -> np.ndarray:
    """The picture, and beside it what is lost (red) and taken (blue)."""
    picture = 255 * np.clip(seen.image, 0, 1) ** (1 / 2.2)
    marked = 0.5 * picture
    found, true = seen.skin > 0.5, seen.true > 0.5
    marked[found & true] = picture[found & true]
    marked[true & ~found] = 0.5 * picture[true & ~found] + (120, 0, 0)
    marked[found & ~true] = 0.5 * picture[found & ~true] + (0, 0, 160)
    both = np.hstack([picture, marked])
    return cv2.resize(np.clip(both, 0, 255).astype(np.uint8), None, fx=0.5, fy=0.5)


def main() -> None:
    """Render what is missing, then the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--work", type=Path, required=True, help="folder of the rendered pictures")
    parser.add_argument("--only", default="", help="cases whose name has this in it")
    parser.add_argument("--sheet", type=Path, help="also a picture of all masks")
    options = parser.parse_args()
    every: list[dict[str, float]] = []
    rows: list[np.ndarray] = []
    print("| case | IoU, by light | lost | taken | alpha |\n|---|---|---|---|---|")
    for case, pictures in cells(options.work, options.only):
        found = [perceive(cell) for cell in pictures]
        seen = [s for s in found if s is not None]
        scores = [score(s) for s in seen]
        missed = len(found) - len(seen)
        if options.sheet:
            rows.append(np.hstack([overlay(s) for s in seen[:4]]))
        if case == "same head":
            print(f"\none head, six lights: {agreement([s.skin for s in seen]):.3f}")
            continue
        every += scores
        print(
            f"| {case} | {_line(scores)}{f' | {missed} not found' if missed else ''} |", flush=True
        )
    if every:
        ious = [s["iou"] for s in every]
        print(f"\nall {len(every)}: IoU mean {np.mean(ious):.3f}, worst {min(ious):.3f}")
        print(f"lost | taken | alpha: {_line(every, each=False)}")
    if options.sheet and rows:
        wide = max(row.shape[1] for row in rows)
        rows = [np.pad(row, ((0, 0), (0, wide - row.shape[1]), (0, 0))) for row in rows]
        cv2.imwrite(str(options.sheet), np.vstack(rows)[..., ::-1])


def _line(scores: list[dict[str, float]], each: bool = True) -> str:
    parts = [" / ".join(f"{s['iou']:.2f}" for s in scores)] if each else []
    for name in ("lost", "taken", "alpha"):
        values = [s[name] for s in scores if name in s]
        parts.append(f"{np.mean(values):.3f}" if values else "")
    return " | ".join(parts)


if __name__ == "__main__":
    main()
