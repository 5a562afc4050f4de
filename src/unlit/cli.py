"""The command line: parses and prints, computes nothing.

Exit codes: 0 done; 1 an error in the input or on this machine; 2 wrong usage or settings; 130
interrupted by Ctrl-C; 143 asked to end. Every error a user can mend is one line on standard error.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .errors import SettingsError, UnlitError

if TYPE_CHECKING:
    from .optimize.schedule import Settings
    from .photo import Photo

#: Kept here, too, so that the help does not wait for the renderer.
PRESETS = ("paper", "draft")
EXPORTS = ("glb", "obj", "ply", "mitsuba", "blender")
_DEMO_FOLDER = "unlit-demo"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    with contextlib.suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, _end)
    try:
        options = _parser().parse_args(arguments)
        code = options.run(options)
        sys.stdout.flush()
        return code
    except Exception as error:
        return _explain(_cause(error))
    except KeyboardInterrupt as error:
        return _explain(error)


def _cause(error: BaseException) -> BaseException:
    """What went wrong: Dr.Jit wraps whatever is raised inside a custom operation, Ctrl-C too."""
    inner = error.__cause__ or error.__context__
    return _cause(inner) if type(error) is RuntimeError and inner is not None else error


def _explain(error: BaseException) -> int:
    """Print one line about `error` and return the exit code; what is no user's doing is raised."""
    match error:
        case SettingsError():
            return _fail(error, 2)
        case UnlitError():
            return _fail(error, 1)
        case KeyboardInterrupt():
            print("unlit: interrupted; nothing half-written is left, run it again", file=sys.stderr)
            return 130
        case BrokenPipeError():
            _drop_output()
            return 141
        case MemoryError():
            return _fail(_MEMORY, 1)
        case RuntimeError() if "out of memory" in str(error):  # the renderer's own way to say it
            return _fail(_MEMORY, 1)
        case OSError(errno=errno.ENOSPC | errno.EDQUOT):
            _drop_output()
            return _fail(f"{error.filename or 'the disk'}: no space left; free some", 1)
        case PermissionError():
            return _fail(f"{error.filename or 'a file'}: no permission; change its rights", 1)
    raise error


_MEMORY = "not enough memory: close programs, or use --preset draft or a lower --resolution"


def _fail(error: Exception | str, code: int) -> int:
    print(f"unlit: error: {' '.join(str(error).split())}", file=sys.stderr)
    return code


def _drop_output() -> None:
    """Let go of what standard output still holds, so that it does not raise again at exit."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _end(number: int, frame: Any) -> NoReturn:
    raise SystemExit(128 + number)


def _reconstruct(options: argparse.Namespace) -> int:
    from .photo import read_photo

    return _run(lambda: read_photo(options.photo), options)


def _demo(options: argparse.Namespace) -> int:
    def astronaut() -> Photo:
        from skimage.data import astronaut

        from .photo import Photo

        return Photo.of(astronaut(), "astronaut.png")

    return _run(astronaut, options)


def _run(read: Any, options: argparse.Namespace) -> int:
    """Read the photo, reconstruct it, save it: shared by `reconstruct` and `demo`."""
    from .console import RunConsole, settings_block

    settings = _settings(options)
    from .optimize.schedule import as_dict
    from .output import FILES, needed_bytes, preview_png, reserve, save, write_one

    plain = as_dict(settings)
    stages = {name: value["iterations"] for name, value in plain.items() if isinstance(value, dict)}
    folder = Path(options.output)
    with reserve(folder, FILES, needed_bytes(settings.resolution)) as preview:
        photo = read()
        _fetch_models("reconstruct")
        from .pipeline import reconstruct

        with RunConsole(stages) as console:
            height, width = photo.pixels.shape[:2]
            console.say(f"photo     {photo.source}, {width} x {height}, {photo.colours}")
            console.say(f"preset    {options.preset}")
            for line in settings_block(plain):
                console.say(line)
            console.say(f"preview   {preview}")
            result = reconstruct(
                photo,
                settings=settings,
                face=options.face,
                progress=console,
                preview=lambda _, state: write_one(preview, preview_png(state)),
            )
            for name, value in result.metrics.items():
                if isinstance(value, int | float):
                    console.say(f"{name}  {value:.4g}")
            save(result, folder, console.log())
    print(folder / "montage.png")
    return 0


def _settings(options: argparse.Namespace) -> Settings:
    """Preset, then --config, then --resolution and --seed, then --set."""
    from .optimize.schedule import PRESETS, override

    changes: dict[str, Any] = {}
    if options.config is not None:
        changes |= _config(Path(options.config))
    for name in ("resolution", "seed"):
        if getattr(options, name) is not None:
            changes[name] = getattr(options, name)
    settings = override(PRESETS[options.preset], changes)
    return override(settings, dict(options.set))


def _config(path: Path) -> dict[str, Any]:
    """Settings of a TOML file: at its top level, or in the table `settings` of a saved result."""
    import tomllib

    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        raise SettingsError(f"{path}: no valid TOML ({error})") from error
    inner = values.get("settings", values)
    if not isinstance(inner, dict):
        raise SettingsError(f"{path}: settings must be a table")
    return inner


def _evaluate(options: argparse.Namespace) -> int:
    settings = _settings(options)
    from .evaluate import command

    inputs, folder = [Path(name) for name in options.inputs], Path(options.output)
    if not options.same_person and len(inputs) != 1:
        raise SettingsError("evaluate one subject at a time, or photos with --same-person")
    _refuse_unused(options)
    # LPIPS compares relit pictures, which only the whole protocol makes.
    whole = not (options.same_person or options.check)
    _fetch_models("reconstruct", *(["evaluate"] if whole else []))
    if options.same_person:
        print(command.run_persons(inputs, folder, settings, options.face))
    elif options.check:
        print(command.run_check(inputs[0], folder, settings))
    else:
        lights = (options.lights or "flash,uniform").split(",")
        samples, ablation, own = options.samples or 256, options.ablation, options.true_mesh
        print(command.run_subject(inputs[0], folder, settings, lights, samples, ablation, own))
    return 0


def _refuse_unused(options: argparse.Namespace) -> None:
    """Raise SettingsError for an option that the asked kind of evaluation has no use for."""
    of_protocol = {
        "--lights": options.lights is not None,
        "--samples": options.samples is not None,
        "--true-mesh": options.true_mesh,
    }
    of_photos = {"--face": options.face != "only"}
    if options.same_person:
        kind, unused = "--same-person", of_protocol
    elif options.check:
        kind, unused = "--check", of_protocol | of_photos
    else:
        kind, unused = "a subject", of_photos
    for name, given in unused.items():
        if given:
            raise SettingsError(f"{name} has no use with {kind}; leave it out")


def _montage(options: argparse.Namespace) -> int:
    from .output import load, montage_png, write_one

    path = Path(options.folder) / "montage.png"
    write_one(path, montage_png(load(options.folder)))
    print(path)
    return 0


def _export(options: argparse.Namespace) -> int:
    from .console import StepConsole
    from .output import export, load

    source = Path(options.folder)
    target = Path(options.output) if options.output else source / "export"
    size, directx, progress = options.size, options.directx, StepConsole()
    print(export(load(source), target, source, options.format, size, directx, progress))
    return 0


def _models(options: argparse.Namespace) -> int:
    from . import assets

    if options.action == "fetch":
        _fetch_models()
    if options.action == "licences":
        for entry in assets.ASSETS.values():
            print(f"{entry.name}\n  {entry.purpose}\n  {entry.licence}: {entry.licence_url}")
            print(f"  from {entry.origin}")
        return 0
    found = assets.statuses()
    for status in found:
        entry = status.asset
        print(f"{entry.name}  {entry.size / 1e6:.1f} MB  {entry.licence}\n  {entry.purpose}")
        print(f"  {status.problem or f'verified: {status.path}'}")
        if options.action == "verify":
            print(f"  sha256 {entry.sha256}")
    missing = any(status.problem for status in found)
    if missing:
        print("`unlit models fetch` gets what is missing.")
    return int(missing and options.action == "verify")


def _fetch_models(*commands: str) -> None:
    """Fetch what is missing of the models that `commands` need, or of all."""
    from . import assets
    from .console import FetchConsole

    progress = FetchConsole()
    for name, entry in assets.ASSETS.items():
        if not commands or entry.command in commands:
            assets.asset(name, progress)


def _doctor(options: argparse.Namespace) -> int:
    from .doctor import checks

    found = checks()
    width = max(len(check.name) for check in found)
    for check in found:
        print(f"{'ok ' if check.ok else 'BAD'}  {check.name:<{width}}  {check.detail}")
        if check.remedy:
            print(f"     {'':<{width}}  -> {check.remedy}")
    return int(not all(check.ok for check in found))


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        from importlib.metadata import version

        print(f"unlit {version('unlit')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="unlit",
        description="One photo of a face in; mesh, albedo, normals and light out.",
        epilog="example:\n  unlit reconstruct portrait.jpg -o portrait\n\n"
        "`unlit COMMAND --help` says more about a command.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    reconstruct = _command(
        commands,
        "reconstruct",
        _reconstruct,
        "a photo to a folder of maps, mesh and light",
        "Reconstruct the face in PHOTO (JPEG, PNG, TIFF, WebP, HEIC) into the folder DIR. While "
        "it runs, DIR/unlit-preview.png shows the state after each stage; all results come at the "
        "end, at once. An older result in DIR is replaced.",
        "  unlit reconstruct portrait.jpg -o portrait\n"
        "  unlit reconstruct group.jpg -o second --face 1 --preset draft\n"
        "  unlit reconstruct portrait.jpg -o again --config portrait/reconstruction.toml \\\n"
        "      --set stage2.iterations=500",
    )
    reconstruct.add_argument("photo", metavar="PHOTO", help="the picture file")
    reconstruct.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write")
    _add_settings(reconstruct, "paper")

    demo = _command(
        commands,
        "demo",
        _demo,
        "try it on a photo that comes with scikit-image",
        "Reconstruct the astronaut Eileen Collins (public domain, comes with scikit-image).",
        "  unlit demo\n  unlit demo -o astronaut --preset paper",
    )
    demo.add_argument(
        *("-o", "--output"), metavar="DIR", default=_DEMO_FOLDER, help=f"({_DEMO_FOLDER})"
    )
    _add_settings(demo, "draft")

    evaluate = _command(
        commands,
        "evaluate",
        _evaluate,
        "measure the method on a subject whose truth is known",
        "Photograph a scanned head under known lights, reconstruct it from each photo, relight it "
        "by the others and compare: the paper's Tables 2 and 3. SUBJECT is a subject.toml or its "
        "folder (docs/evaluation.md). Finished steps stay in DIR/steps and are not repeated.",
        "  unlit evaluate scan/subject.toml -o scan-check --check\n"
        "  unlit evaluate scan -o results --lights flash,uniform,side --ablation\n"
        "  unlit evaluate --same-person noon.jpg window.jpg lamp.jpg -o alike",
    )
    evaluate.add_argument("inputs", metavar="SUBJECT", nargs="+", help="or photos of one person")
    evaluate.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write")
    kinds = evaluate.add_mutually_exclusive_group()
    kinds.add_argument("--check", action="store_true", help="only render it under three lights")
    kinds.add_argument("--ablation", action="store_true", help="also switch each stage off")
    kinds.add_argument(
        "--same-person", action="store_true", help="photos of one person: compare their albedos"
    )
    evaluate.add_argument(
        "--lights",
        metavar="LIST",
        help="of flash, uniform, side, and .hdr or .exr files (flash,uniform)",
    )
    evaluate.add_argument(
        "--samples", type=_samples, metavar="N", help="of the path tracer, per pixel (256)"
    )
    evaluate.add_argument(
        "--true-mesh", action="store_true", help="give the reconstruction the subject's own mesh"
    )
    _add_settings(evaluate, "paper")

    montage = _command(
        commands,
        "montage",
        _montage,
        "draw a result's overview picture anew",
        "Draw DIR/montage.png of a saved result anew and print its path: photo, render, error, "
        "maps, light, mesh, and the face under three new lights.",
        "  unlit montage portrait",
    )
    montage.add_argument("folder", metavar="DIR", help="a folder that `unlit reconstruct` wrote")

    export = _command(
        commands,
        "export",
        _export,
        "write a result for Blender, Mitsuba, game engines and viewers",
        "Bake the maps of the result in DIR to the mesh's texture coordinates and write them with "
        "the mesh, light and camera (docs/outputs.md). Prints the folder written.",
        "  unlit export portrait\n"
        "  unlit export portrait -o unreal --format glb,obj --size 2048 --directx",
    )
    export.add_argument("folder", metavar="DIR", help="a folder that `unlit reconstruct` wrote")
    export.add_argument("-o", "--output", metavar="OUT", help="folder to write (DIR/export)")
    export.add_argument(
        "--format",
        type=lambda text: text.split(","),
        default=list(EXPORTS),
        metavar="LIST",
        help=f"of {', '.join(EXPORTS)}, usd ({','.join(EXPORTS)})",
    )
    export.add_argument(
        "--size", type=int, default=1024, metavar="N", help="texels a side, 512 to 4096 (1024)"
    )
    export.add_argument(
        "--directx", action="store_true", help="normal maps (PNG) with y down, as Unreal wants"
    )

    models = _command(
        commands,
        "models",
        _models,
        "list, fetch and verify the model files",
        "The model files unlit reads but does not ship: what they are, where they are, and under "
        "which licence. They are fetched by the first run; for a machine without network, fetch "
        "them elsewhere and name their folder in the environment variable UNLIT_MODELS.",
        "  unlit models\n  unlit models fetch\n  unlit models licences",
    )
    models.add_argument(
        "action",
        nargs="?",
        choices=("list", "fetch", "verify", "licences"),
        default="list",
        help="list (default); fetch what is missing; verify (exit code 1 if one is bad); licences",
    )

    _command(
        commands,
        "doctor",
        _doctor,
        "say what works on this machine and how to mend what does not",
        "Look at Python, the renderer, its back end, the models, memory and disk.",
        "  unlit doctor",
    )
    return parser


def _command(
    commands: Any, name: str, run: Any, summary: str, description: str, examples: str
) -> argparse.ArgumentParser:
    import textwrap

    parser = commands.add_parser(
        name,
        help=summary,
        description=textwrap.fill(description, 90),
        epilog=f"example{'s' if examples.count('unlit ') > 1 else ''}:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


def _add_settings(parser: argparse.ArgumentParser, preset: str) -> None:
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        default=preset,
        help=f"paper: the whole schedule at 512 pixels; draft: a quick look at 256 ({preset})",
    )
    parser.add_argument(
        "--resolution", type=int, metavar="N", help="side of the face crop, 256 to 2048 pixels"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of random choices")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=_assignment,
        metavar="NAME=VALUE",
        help="override one setting, e.g. stage2.iterations=500; may be repeated",
    )
    parser.add_argument(
        "--config",
        metavar="FILE.toml",
        help="settings from a TOML file, or those of an older result's reconstruction.toml",
    )
    parser.add_argument(
        "--face",
        type=_face,
        default="only",
        metavar="largest|N",
        help="which face if there are several: the largest, or a number from 0, large to small",
    )


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r}: write NAME=VALUE")
    return name.strip(), value.strip()


def _samples(text: str) -> int:
    if text.isdecimal() and 1 <= int(text) <= 65536:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r}: write a number from 1 to 65536")


def _face(text: str) -> str | int:
    if text in ("largest", "only"):
        return text
    if text.isdecimal():
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r}: write largest, or a number from 0")
