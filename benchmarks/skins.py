"""Whether the method serves all skins alike: one face, painted light, medium and dark.

    python benchmarks/skins.py [--exposure same|each] [--true-mesh] [--steps DIR] [-o FILE]

The same person (ICT-FaceKit, seed 24, yaw 8) is photographed in three skins under uniform light, a
flash and a lamp from the side, reconstructed at `draft` as from any photo, and relit by all three.
--exposure same: every skin in the light that exposes the light one at 0.8, as when all stand in one
picture; each: every photo exposed for its own skin. The table gives PSNR (dB, sRGB, inside the
face, after one gain), the mean over the three lights, that of the albedo map, and the spread: the
best skin's less the worst's.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from geometry import SIZE
from painting import SKINS
from subjects import SHARED, ict

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
from unlit.evaluate.command import light
from unlit.evaluate.metrics import flip_package
from unlit.evaluate.protocol import Shot, ShotResult, Study
from unlit.evaluate.step_cache import StepCache
from unlit.evaluate.table import Table, markdown
from unlit.settings.settings import PRESETS
from unlit.storage.keys import key

LIGHTS = ("uniform", "flash", "side")
_SEED, _YAW = 24, 8.0


def study(skin: str, steps: Path, true_mesh: bool, samples: int) -> Study:
    """The person in one skin, under all lights."""
    subject = ict(skin, _SEED, SIZE, _YAW)
    content = key(skin, *subject.mesh(), *vars(subject.truth).values())
    settings = replace(PRESETS["draft"], resolution=SIZE)
    lights = tuple(light(name) for name in LIGHTS)
    store = StepCache(steps / skin)
    return Study(subject, content, lights, settings, store, samples, true_mesh=true_mesh)


def in_light_of(shot: Shot, other: Shot) -> Shot:
    """`shot` under a light as strong as that of `other`."""
    gain = np.float32(other.light.environment.sum() / shot.light.environment.sum())
    return Shot(other.light, shot.image * gain)


def table(results: dict[str, list[ShotResult]]) -> Table:
    """One line an input light: mean over the lights it is relit by, and albedo, of each skin."""
    body = []
    for rows in zip(*results.values(), strict=True):
        relit = [np.mean([x.metrics["gained"]["face"]["psnr"] for x in r.relit]) for r in rows]
        albedo = [r.maps["albedo_psnr"] for r in rows]
        cells = (
            " / ".join(f"{x:.1f}" for x in values) + f" ({np.ptp(values):.1f})"
            for values in (relit, albedo)
        )
        body.append((rows[0].light, *cells))
    return Table(
        f"PSNR, {' / '.join(results)} skin (spread)", ("input", "relit", "albedo"), tuple(body)
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--exposure", choices=("same", "each"), default="same")
    parser.add_argument("--true-mesh", action="store_true", help="give the person's own mesh")
    parser.add_argument("--samples", type=int, default=64, help="of the path tracer, per pixel")
    parser.add_argument("--steps", type=Path, help="folder of finished steps")
    parser.add_argument("-o", "--output", type=Path, help="write the Markdown table here, too")
    options = parser.parse_args()
    flip_package()
    if not (SHARED / "data").is_dir():
        parser.error(f"{SHARED}: the licensed test data are not there")
    with tempfile.TemporaryDirectory() as temporary:
        steps = options.steps or Path(temporary)
        studies = {x: study(x, steps, options.true_mesh, options.samples) for x in SKINS}
        shots = {name: each.shots() for name, each in studies.items()}
        if options.exposure == "same":
            reference = shots["light"]
            shots = {name: tuple(map(in_light_of, own, reference)) for name, own in shots.items()}
        results = {name: list(each.rows(shots[name])) for name, each in studies.items()}
    mesh = "the person's own mesh" if options.true_mesh else "mesh fitted"
    facts = [f"draft, {SIZE} x {SIZE} pixels, {mesh}, exposure: {options.exposure}"]
    text = markdown("Skins", facts, [table(results)])
    print(text)
    if options.output:
        options.output.write_text(text)


if __name__ == "__main__":
    main()
