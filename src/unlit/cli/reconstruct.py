"""`unlit reconstruct`: a photo to a folder of maps, mesh and light."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import OutputError, SettingsError
from . import models
from .answer import add_json, answer
from .arguments import user_path
from .parser import command, refuse_unused
from .settings import add_settings, assigned, settings_of

if TYPE_CHECKING:
    from ..face.reconstruction import Reconstruction
    from ..output.save import Page
    from ..progress.console import RunConsole
    from ..progress.log import Log
    from ..settings.settings import Settings

#: Options of a reconstruction from the start.
_FRESH = (
    *("photo", "mask", "model", "preset", "resolution", "memory", "light_color", "sun"),
    *("cast_shadows", "config", "face"),
)


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "reconstruct",
        run,
        "a photo to a folder of maps, mesh and light",
        "Reconstruct the face in PHOTO (JPEG, PNG, TIFF, WebP, HEIC, AVIF) into the folder DIR. "
        "While it runs, DIR/unlit-preview.png shows the state after each stage; all results come "
        "at the end, at once. An older result in DIR is replaced. The state is kept in DIR after "
        "every stage: the same command with --resume goes on after Ctrl-C, a crash or kill -9, "
        "and gives the same bits. To go on from a saved result instead, edit its albedo maps or "
        "its mask, and name the folder and the first stage to run again.",
        "  unlit reconstruct portrait.jpg -o portrait\n"
        "  unlit reconstruct --resume portrait\n"
        "  unlit reconstruct group.jpg -o second --face 1 --preset draft\n"
        "  unlit reconstruct portrait.jpg -o bare --mask skin.png\n"
        "  unlit reconstruct candles.jpg -o card --light-color 1210,640 --exposure 880,700=0.35\n"
        "  unlit reconstruct portrait.jpg -o again --config portrait/reconstruction.toml \\\n"
        "      --set stage2.iterations=500\n"
        "  unlit reconstruct --resume portrait --from-stage 4 -o edited",
    )
    parser.add_argument(
        "photo", type=user_path, metavar="PHOTO", nargs="?", help="the picture file"
    )
    parser.add_argument("-o", "--output", type=user_path, metavar="DIR", help="folder to write")
    parser.add_argument(
        "--mask",
        type=user_path,
        metavar="FILE",
        help="picture of the photo's size: white is face skin to use, black is to be left out",
    )
    parser.add_argument(
        "--resume",
        nargs="?",
        type=user_path,
        const=True,
        metavar="DIR",
        help="go on with the unfinished run in DIR (or in that of -o), from its last whole stage; "
        "PHOTO may be left out",
    )
    parser.add_argument(
        "--from-stage",
        type=int,
        choices=range(1, 6),
        metavar="N",
        help="run stages N to 5 again on the result in --resume DIR, with its maps, edited or not, "
        "as the start; into DIR, or that of -o",
    )
    add_settings(parser, "standard")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from ..photo.photo import read_photo

    if options.from_stage is not None:
        options.again = ", the saved result is as it was; run the same command again"
        return _continue(options)
    options.again += " with --resume to go on"
    named = options.resume if isinstance(options.resume, str) else None
    if options.photo is None and options.output is not None:
        options.photo, named = named, None  # it was written --resume PHOTO -o DIR
    options.output = options.output or named
    if options.photo is None and options.resume is not None and options.output is not None:
        options.photo = _photo_of_run(Path(options.output))
    if options.photo is None:
        raise SettingsError("no PHOTO given")
    if options.output is None:
        raise SettingsError("no folder to write given; add -o DIR")
    if named is not None and Path(named) != Path(options.output):
        raise SettingsError(f"--resume {named} and -o {options.output} differ; leave one out")
    resume = options.resume is not None
    return reconstruct_into(lambda: read_photo(options.photo), options, options.mask, resume)


def _photo_of_run(folder: Path) -> str:
    """The photo of the unfinished run in `folder`. Raises SettingsError where it is not kept."""
    from ..storage.folder import CHECKPOINT

    state = folder / CHECKPOINT
    photo = ""
    if state.exists():
        from ..optimize.checkpoint import photo_of_run

        photo = photo_of_run(state)
    if not photo:
        raise SettingsError(
            f"{folder}: no unfinished run there that tells its photo; name it, as `unlit "
            "reconstruct PHOTO --resume DIR`; to go on from a saved result, give --from-stage N too"
        )
    return photo


def _say_finished(options: argparse.Namespace, folder: Path, result: Reconstruction) -> None:
    """Print the montage's path, the only result, and beside it what can be done next."""
    import shlex

    from ..report.bundle import missing_because, program
    from ..storage.folder import REPORT

    answer(options, folder / "montage.png", **(_fields(folder, result) if options.json else {}))
    name = shlex.quote(str(folder))
    print(f"open {folder / REPORT} in a browser, or run `unlit view {name}`", file=sys.stderr)
    if program() is None:
        why = f"{missing_because()}; `unlit doctor` says what to do"
        print(f"the report is without its viewer in three dimensions: {why}", file=sys.stderr)


def _fields(folder: Path, result: Reconstruction) -> dict[str, Any]:
    """For scripts: what was written, how well it fits, and what it took."""
    from ..evaluate.metrics import psnr
    from ..output.save import RESULT_FILES

    inside, metrics = result.face.mask > 0, result.metrics
    match = psnr(result.images.render, result.photo.image, inside) if inside.any() else None
    files = sorted(folder / name for name in RESULT_FILES if (folder / name).exists())
    return {
        "folder": folder,
        "files": files,
        "warnings": list(metrics.warnings),
        "metrics": {
            "render_psnr_db": match,
            "landmark_residual": result.head.landmark_residual,
            "unit_cd_m2": result.photo.white_luminance,
            "losses": {stage: points[-1][1] for stage, points in metrics.losses.items() if points},
            "steps_seconds": metrics.seconds,
            "peak_memory_mb": metrics.peak_memory_mb,
        },
    }


def reconstruct_into(
    read: Any,
    options: argparse.Namespace,
    mask: str | None = None,
    resume: bool = False,
) -> int:
    """Read the photo, reconstruct it, save it: shared by `reconstruct` and `demo`.

    mask: a picture file. resume: go on with an unfinished run.
    """

    settings = settings_of(options)
    from ..output.save import RESULT_FILES, needed_bytes
    from ..storage.folder import CHECKPOINT, MARK, reserve

    folder = Path(options.output)
    with reserve(folder, RESULT_FILES, needed_bytes(settings.resolution)) as preview:
        options.preview = preview
        photo = read()
        models.fetch("reconstruct")
        from ..head.sources.library import head_model
        from ..optimize.checkpoint import Checkpoint
        from ..pipeline.chain import reconstruct

        head = head_model(settings.head_model)
        checkpoint = Checkpoint(folder / CHECKPOINT, resume, _absolute(options))
        if resume and not checkpoint.stage and (folder / MARK).exists():
            finished = _finished(folder, photo, settings)
            print(f"{folder}: finished before, nothing to resume", file=sys.stderr)
            _say_finished(options, folder, finished)
            return 0
        height, width = photo.pixels.shape[:2]
        facts = {"photo": f"{photo.source}, {width} x {height}, {photo.colours}"}
        if mask is not None:
            facts["mask"] = mask
        facts["preset"] = options.preset
        facts["model"] = f"{head.name}, {head.licence}"
        if resume:
            stage = checkpoint.stage
            found = f"after stage {stage}" if stage else "nothing to resume, from the start"
            facts["resume"] = found
        with _console(facts, settings, preview, checkpoint.stage) as console:
            states = _States(preview)
            result = reconstruct(
                photo,
                settings=settings,
                face=options.face,
                mask=mask,
                model=head,
                progress=console,
                preview=states,
                checkpoint=checkpoint,
            )
            _save(console.log, result, folder, states)
    _say_finished(options, folder, result)
    return 0


def _absolute(options: argparse.Namespace) -> str:
    """The photo's file, whatever the working directory of who resumes; "" for the demo's."""
    photo = getattr(options, "photo", None)
    return str(Path(photo).absolute()) if photo else ""


def _finished(folder: Path, photo: Any, settings: Any) -> Reconstruction:
    """The result in `folder`. Raises OutputError if it is not what is asked for: it stays."""
    from ..output.load import load

    found = load(folder)
    if (found.photo.name, found.settings) != (Path(photo.source).name, settings):
        raise OutputError(
            f"{folder}: holds a finished result of {found.photo.name} and nothing to resume; leave "
            "--resume out to replace it"
        )
    return found


def _continue(options: argparse.Namespace) -> int:
    """Run some stages again on a saved result."""
    refuse_unused(options, _FRESH, "--from-stage")
    named = options.resume if isinstance(options.resume, str) else options.output
    if named is None:
        raise SettingsError("--from-stage: name the folder of the result, as --resume DIR")
    from ..output.edits import edited
    from ..output.load import load
    from ..output.save import RESULT_FILES, needed_bytes
    from ..settings.settings import override
    from ..storage.folder import reserve

    source, stage = Path(named), options.from_stage
    face = load(source)
    changes = {} if options.exposure is None else {"exposure": options.exposure}
    settings = override(face.settings, changes | assigned(options))
    folder = Path(options.output or named)
    with reserve(folder, RESULT_FILES, needed_bytes(settings.resolution)) as preview:
        from ..pipeline.resume import check_resumable, resume

        check_resumable(face, stage, settings)
        face, files = edited(face, source, stage)
        pull = "; a start, on which the photo pulls again" if files else ""
        facts = {
            "result": f"{source}, of {face.photo.name}, from stage {stage}",
            "edited": f"{', '.join(files) or 'nothing'}{pull}",
        }
        with _console(facts, settings, preview, stage - 1) as console:
            states = _States(preview)
            result = resume(face, stage, settings, console, states)
            _save(console.log, result, folder, states)
    _say_finished(options, folder, result)
    return 0


def _console(facts: Mapping[str, str], settings: Settings, preview: Path, done: int) -> RunConsole:
    """For a run whose stages up to `done` are over: says `facts` and what the rest will take."""
    from ..machine import cost
    from ..progress.console import RunConsole
    from ..progress.log import settings_lines
    from ..settings.settings import as_dict

    cores = cost.cores()
    plan = cost.plan(settings.resolution, settings.iterations(done), cores, settings.solver)
    console = RunConsole(plan)
    say = console.log.say
    for name, fact in facts.items():
        say(f"{name:<9} {fact}")
    console.log.note(*settings_lines(as_dict(settings)))
    say(
        f"expects   some {sum(plan.values()) / 60:.1f} minutes on {cores} cores, "
        f"{cost.memory(settings.resolution) / 1e9:.1f} GB of memory at most"
    )
    say(f"preview   {preview}")
    return console


class _States:
    """Shows the state after the fit and each stage as the preview, and keeps it for the report."""

    def __init__(self, preview: Path) -> None:
        self.preview = preview
        self.taken: list[tuple[str, dict[str, bytes]]] = []

    def __call__(self, stage: str, state: Any) -> None:
        from ..output.montage import preview_png
        from ..report.stages import stage_pictures
        from ..storage.folder import write_one

        write_one(self.preview, preview_png(state))
        self.taken.append((stage, stage_pictures(state)))


def _save(log: Log, result: Any, folder: Path, states: _States) -> None:
    from ..output.save import save
    from ..report.page import report_html
    from ..report.stages import pack_stages
    from ..storage.folder import REPORT, STAGES

    if (residual := result.head.landmark_residual) is not None:
        log.say(f"landmark_residual  {residual:.4g}")
    log.say(f"peak_memory_mb  {result.metrics.peak_memory_mb:.4g}")
    if (luminance := result.photo.white_luminance) is not None:
        log.say(f"unit_cd_m2  {luminance:.4g}")
    for warning in result.metrics.warnings:
        log.say(f"warning  {warning}")
    pages: dict[str, Page] = {
        STAGES: lambda atlas, pictures: pack_stages(states.taken),
        REPORT: lambda atlas, pictures: report_html(result, atlas, states.taken, pictures).encode(),
    }
    save(result, folder, log.text(), pages)
