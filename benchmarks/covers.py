"""Are glasses, beards, hats and fringes found, and not seen on bare heads?

    python benchmarks/covers.py --work DIR [--heads 20] [--bare 60]

Random heads, skins, hair and lights, path-traced as in masks.py; what is found is what the command
warns of (perception/covers.py). Rendered pictures are kept in DIR.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
import snapshots
from dressed import HAIR
from masks import content_of, scene

from unlit.errors import FaceError
from unlit.perception.covers import LEAST, worn
from unlit.photo.photo import Photo
from unlit.pipeline.observe import observe
from unlit.storage.keys import key

SIZE = 256
SAMPLES = 12
#: By name of what is to be found, the cases of masks.py that have it.
WORN = {
    "glasses": ("clear glasses",),
    "tinted glasses": ("tinted glasses",),
    "beard": ("full beard",),
    "hat": ("hat",),
    "hair": ("blond fringe", "short fringe"),
}
BARE = ("bald", "short hair", "loose strands", "stubble")


def picture(work: Path, case: str, number: int) -> np.ndarray:
    """(256, 256, 3) uint8 sRGB: a random head in that case, under a random light."""
    rng = np.random.default_rng([number, len(case)])
    hair = str(rng.choice(list(HAIR)))
    built = scene(case, number, hair, SIZE)
    light, behind = snapshots.random_light(rng), snapshots.background(SIZE, rng)
    this = key(content_of(built, SIZE, SAMPLES), light, behind)[:12]
    file = work / f"covers-{case.replace(' ', '-')}-{this}.npz"
    if not file.exists():
        developed = snapshots.developed(built.photograph(light, SAMPLES, number), behind, rng)
        work.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, picture=developed)
    with np.load(file) as data:
        return data["picture"]


def found_on(image: np.ndarray) -> set[str]:
    """What is found on the largest face; nothing where no face is."""
    try:
        seen = observe(Photo.of(image, "head"), SIZE, "largest")
    except FaceError:
        return set()
    shares = seen.regions.shares
    assert shares is not None
    return set(worn(shares, seen.landmarks[:, :2], SIZE))


def heads(work: Path, cases: tuple[str, ...], count: int) -> Iterator[set[str]]:
    """What is found on each of `count` heads of these cases."""
    for number in range(count):
        yield found_on(picture(work, cases[number % len(cases)], 500 + number))


def main() -> None:
    """One line for each of WORN, then the false alarms."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--work", type=Path, required=True, help="folder of the rendered pictures")
    parser.add_argument("--heads", type=int, default=20, help="of each kind")
    parser.add_argument("--bare", type=int, default=60, help="heads that wear nothing")
    options = parser.parse_args()
    print("| worn | found |\n|---|---|")
    for name, cases in WORN.items():
        told = list(heads(options.work, cases, options.heads))
        print(f"| {name} | {sum(name in t for t in told)} of {len(told)} |", flush=True)
    told = list(heads(options.work, BARE, options.bare))
    alarms = {name: sum(name in t for t in told) for name in LEAST}
    print(f"\nfalse alarms on {len(told)} bare heads: {alarms}")


if __name__ == "__main__":
    main()
