"""What `unlit evaluate` does: reads, runs the protocol, writes tables and pictures."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..errors import FaceError, SettingsError, SubjectError
from ..face.reconstruction import Reconstruction
from ..head.model import HeadModel
from ..head.sources.library import head_model, model_key
from ..output.images import png
from ..photo.photo import Photo, read_photo
from ..pipeline.chain import reconstruct
from ..pipeline.identity import identity_of, photo_content
from ..progress.console import StudyConsole
from ..relighting.lights import LIGHTS, environment_map
from ..settings.settings import Settings, as_dict
from ..storage.folder import write_one
from ..storage.keys import key
from .figure import check_sheet, result_sheet
from .metrics import flip_package
from .persons import consistency
from .protocol import NamedLight, ShotResult, Study
from .step_cache import StepCache
from .subject_file import files_of
from .subject_mesh import read_subject
from .table import Table, markdown, page, tables

_STAGES = (1, 2, 3, 4, 5)
#: The inputs from which a stage is switched off.
_ABLATION = ("flash", "uniform")
_CACHE = "steps"


def light(name: str) -> NamedLight:
    """A light by name (`lights.environment_map`); from a file it has the file's name.

    Raises SettingsError or PictureError.
    """
    return NamedLight(name if name in LIGHTS else Path(name).stem, environment_map(name))


def run_check(file: Path, folder: Path, settings: Settings, watch: StudyConsole) -> Path:
    """Render the subject under three lights; returns the picture's path."""
    plan = EvaluationPlan(("flash", "uniform", "side"), samples=64)
    study = _study(file, folder, settings, plan, watch)
    path = folder / "check.png"
    write_one(path, png(check_sheet(study.subject, study.shots())))
    return path


@dataclass(frozen=True)
class EvaluationPlan:
    """What an evaluation does. lights: as `light` takes them. samples: of the path tracer, per
    pixel, and its seed. ablation: leave out each stage in turn, too. true_mesh: see Study.
    """

    lights: Sequence[str]
    samples: int = 256
    seed: int = 0
    ablation: bool = False
    true_mesh: bool = False


def run_subject(
    file: Path, folder: Path, settings: Settings, plan: EvaluationPlan, watch: StudyConsole
) -> Path:
    """The whole protocol; returns the path of the Markdown tables."""
    flip_package()  # tells now rather than after minutes of work
    if plan.ablation and not set(plan.lights) & set(_ABLATION):
        raise SettingsError(f"an ablation needs {' or '.join(_ABLATION)} among the lights")
    study = _study(file, folder, settings, plan, watch)
    shots = study.shots()
    rows = list(study.rows(shots))
    if plan.ablation:
        for stage in _STAGES:
            rows += study.rows(shots, _ABLATION, stage)
    result = {
        "subject": study.subject.name,
        "unlit": version("unlit"),
        "samples": plan.samples,
        "seed": plan.seed,
        "true_mesh": plan.true_mesh,
        "settings": as_dict(settings),
        "rows": [plain(row) for row in rows],
    }
    facts = [
        f"unlit {version('unlit')}, {settings.resolution} x {settings.resolution} pixels, "
        f"{plan.samples} samples a pixel, iterations "
        + " + ".join(str(stage.iterations) for stage in settings.stages()),
        "the subject's own mesh was given" if plan.true_mesh else "mesh fitted as from any photo",
    ]
    write_one(folder / "figure.png", png(result_sheet(study.subject, rows)))
    return _write(folder, study.subject.name, facts, tables(result), result, ["figure.png"])


def run_persons(
    paths: Sequence[Path], folder: Path, settings: Settings, face: str | int, watch: StudyConsole
) -> Path:
    """One person on several photos; returns the path of the Markdown table."""
    if len(paths) < 2:
        raise FaceError("to compare one person's albedos takes two photos or more")
    photos = [read_photo(path) for path in paths]
    store = StepCache(folder / _CACHE, watch.busy)
    model = head_model(settings.head_model)
    faces = [_person(photo, model, store, settings, face, watch) for photo in photos]
    result = consistency(faces)
    body = [
        (*pair["photos"], f"{pair['albedo_psnr']:.1f}", f"{pair['photo_psnr']:.1f}")
        for pair in result["pairs"]
    ]
    body.append(("mean", "", f"{result['albedo_psnr']:.1f}", f"{result['photo_psnr']:.1f}"))
    table = Table(
        "How much alike (PSNR, dB, sRGB, one gain per channel)",
        ("photo", "and", "their albedos", "the photos themselves"),
        tuple(body),
    )
    facts = [f"{result['points']} points of the face that every photo shows"]
    return _write(folder, "One person, several lights", facts, [table], result, [])


def _person(
    photo: Photo,
    model: HeadModel,
    store: StepCache,
    settings: Settings,
    face: str | int,
    watch: StudyConsole,
) -> Reconstruction:
    name = Path(photo.source)
    made = identity_of(name.name, photo_content(photo), settings, model_key(model), face)

    def make() -> Reconstruction:
        with watch.running(name.stem) as progress:
            return reconstruct(photo, settings=settings, face=face, model=model, progress=progress)

    return store.reconstruction(name.stem, made.key, make)


def _study(
    file: Path, folder: Path, settings: Settings, plan: EvaluationPlan, watch: StudyConsole
) -> Study:
    known = tuple(light(name) for name in plan.lights)
    names = [found.name for found in known]
    for given, name in zip(plan.lights, names, strict=True):
        if names.count(name) > 1:
            raise SettingsError(f"{given}: two lights are called {name!r}; rename one")
    files = files_of(file)
    with watch.busy("reading the subject"):
        content = key(settings.resolution, *map(_digest, files))
        subject = read_subject(file, settings.resolution)
    store = StepCache(folder / _CACHE, watch.busy)
    how = (plan.samples, plan.seed, plan.true_mesh, watch.running)
    return Study(subject, content, known, settings, store, *how)


def _digest(path: Path) -> str:
    """Hash of a file of any size."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise SubjectError(f"{path}: cannot be read ({error.strerror})") from error


def plain(row: ShotResult) -> dict[str, Any]:
    """The figures of a row, without its pictures."""
    return {
        "input": row.light,
        "variant": row.variant,
        "relit": [{"light": cell.light, "metrics": cell.metrics} for cell in row.relit],
        "maps": row.maps,
        "seconds": row.face.metrics.seconds,
    }


def _write(
    folder: Path,
    title: str,
    facts: list[str],
    found: list[Table],
    result: dict[str, Any],
    pictures: list[str],
) -> Path:
    write_one(folder / "evaluation.json", json.dumps(result, indent=1).encode())
    write_one(folder / "evaluation.html", page(title, facts, found, pictures).encode())
    write_one(folder / "evaluation.md", markdown(title, facts, found).encode())
    return folder / "evaluation.md"
