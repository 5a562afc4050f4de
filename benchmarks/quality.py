"""How good the method is, on subjects whose truth is known; a drop against the reference fails.

    python benchmarks/quality.py [--preset draft] [--subjects LIST] [--quick] [--prb]
    python benchmarks/quality.py --geometry ...        the fitted mesh alone: geometry.py

Every subject is photographed under each light, reconstructed as from any photo, and relit by all
of them (unlit.evaluate). The table gives PSNR (dB, sRGB, inside the face, after one global gain)
and LPIPS per cell; `albedo` and `normals` are those of the maps. Figures are held against
quality_reference.json: exit code 1 if a PSNR is more than 0.5 dB lower, or if a figure has no
reference, since then nothing would guard it. `--accept` writes them there instead. Finished steps
are kept in --steps, so that an interrupted run resumes.

`--quick` is what `.ci/run` runs (`--quick -o quality.md`): the two subjects that need no test data,
short schedule, flash and side light, four reconstructions in all. Subjects of another head model
and the scan are not run there; run the whole set by hand before a change of the method is
accepted. `--prb` adds the baseline of benchmarks/prb.py.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import geometry
from prb import baseline_rows
from subjects import standard

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
from unlit.evaluate.command import LIGHTS, light
from unlit.evaluate.metrics import flip_package
from unlit.evaluate.protocol import ShotResult, Study
from unlit.evaluate.step_cache import StepCache
from unlit.evaluate.table import Table, markdown
from unlit.settings.settings import PRESETS
from unlit.storage.keys import key

REFERENCE = Path(__file__).with_name("quality_reference.json")
#: A lower PSNR than the reference's by more than this, dB, is a failure.
TOLERANCE = 0.5


def figures(name: str, preset: str, rows: list[ShotResult]) -> Iterator[tuple[str, float]]:
    """Key and PSNR of every cell and every albedo."""
    for row in rows:
        start = f"{preset}/{name}/{row.light}"
        for cell in row.relit:
            yield f"{start}/{cell.light}", round(cell.metrics["gained"]["face"]["psnr"], 2)
        yield f"{start}/albedo", round(row.maps["albedo_psnr"], 2)


def table(results: dict[str, list[ShotResult]], lights: list[str]) -> Table:
    """One line per subject and input."""
    body = []
    for name, rows in results.items():
        for row in rows:
            cells = [cell.metrics["gained"]["face"] for cell in row.relit]
            relit = (f"{cell['psnr']:.1f} / {cell['lpips']:.3f}" for cell in cells)
            maps = row.maps
            mesh = f"{maps['mesh_mm']['mean']:.1f}"
            normals = f"{maps['normal_degrees']:.1f}"
            body.append((name, row.light, *relit, f"{maps['albedo_psnr']:.1f}", normals, mesh))
    header = ("subject", "input", *lights, "albedo", "normals, degrees", "mesh, mm")
    return Table("PSNR / LPIPS relit under", header, tuple(body))


def drops(found: dict[str, float], known: dict[str, float]) -> list[str]:
    """A line for each figure that fell by more than the tolerance."""
    return [
        f"{name}: {value:.2f} dB, was {known[name]:.2f}"
        for name, value in found.items()
        if name in known and value < known[name] - TOLERANCE
    ]


def unguarded(found: dict[str, float], known: dict[str, float]) -> list[str]:
    """A line for each figure that has no reference."""
    return [
        f"{name}: {value:.2f} dB, no reference; see it is right, then run again with --accept"
        for name, value in found.items()
        if name not in known
    ]


def main() -> int:
    if "--geometry" in sys.argv[1:]:
        return geometry.main([x for x in sys.argv[1:] if x != "--geometry"])
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").splitlines()[0], epilog="--geometry ...: see geometry.py --help"
    )
    parser.add_argument("--preset", choices=tuple(PRESETS), default="draft")
    parser.add_argument("--subjects", default="", help="comma-separated; default all there are")
    parser.add_argument("--lights", default="flash,uniform,side", help="comma-separated")
    parser.add_argument("--samples", type=int, default=64, help="of the path tracer, per pixel")
    parser.add_argument("--true-mesh", action="store_true", help="give each subject's own mesh")
    parser.add_argument("--quick", action="store_true", help="what continuous integration runs")
    parser.add_argument("--prb", action="store_true", help="also stock Mitsuba's prb")
    parser.add_argument("--accept", action="store_true", help="make these the reference figures")
    parser.add_argument("--steps", type=Path, help="folder of finished steps")
    parser.add_argument("-o", "--output", type=Path, help="write the Markdown table here, too")
    options = parser.parse_args()
    flip_package()
    settings = PRESETS["draft" if options.quick else options.preset]
    lights = ["flash", "side"] if options.quick else options.lights.split(",")
    if unknown := set(lights) - set(LIGHTS):
        parser.error(f"no such light: {', '.join(sorted(unknown))}; there are {', '.join(LIGHTS)}")
    subjects = standard(settings.resolution)
    chosen = ["own-light", "own-dark"] if options.quick else list(subjects)
    chosen = options.subjects.split(",") if options.subjects else chosen
    if unknown := set(chosen) - set(subjects):
        parser.error(f"no such subject here: {', '.join(sorted(unknown))}")
    results: dict[str, list[ShotResult]] = {}
    baseline = []
    with tempfile.TemporaryDirectory() as temporary:
        for name in chosen:
            subject = subjects[name]()
            source = Path(standard.__code__.co_filename).read_bytes()
            truth = vars(subject.truth).values()
            content = key(name, settings.resolution, source, *subject.mesh(), *truth)
            study = Study(
                subject,
                content,
                tuple(light(x) for x in lights),
                settings,
                StepCache((options.steps or Path(temporary)) / name),
                options.samples,
                true_mesh=options.true_mesh,
            )
            shots = study.shots()
            results[name] = []
            for row in study.rows(shots):
                results[name].append(row)
                print(f"{name} from {row.light} done", file=sys.stderr, flush=True)
            if options.prb:
                baseline += baseline_rows(subject, name, results[name], shots)
    kind = f"{'draft' if options.quick else options.preset}{'-true-mesh' * options.true_mesh}"
    found = dict(x for name, rows in results.items() for x in figures(name, kind, rows))
    tables = [table(results, lights)]
    if baseline:
        header = ("subject", "input", "method", "ms/iteration", "schedule", *lights, "albedo")
        tables.append(Table("Beside stock Mitsuba prb", header, tuple(baseline)))
    facts = [f"preset {kind}, {settings.resolution} pixels, {options.samples} samples a pixel"]
    text = markdown("Quality", facts, tables)
    print(text)
    if options.output:
        options.output.write_text(text)
    known = json.loads(REFERENCE.read_text()) if REFERENCE.exists() else {}
    if options.accept:
        REFERENCE.write_text(json.dumps(dict(sorted((known | found).items())), indent=1) + "\n")
        return 0
    worse = [f"worse than the reference: {line}" for line in drops(found, known)]
    worse += unguarded(found, known)
    for line in worse:
        print(line, file=sys.stderr)
    return int(bool(worse))


if __name__ == "__main__":
    sys.exit(main())
