"""`unlit models`: list, fetch and verify the model files, add a head model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import SettingsError
from .answer import add_json, answer
from .arguments import user_path
from .parser import command

if TYPE_CHECKING:
    from ..machine.assets import AssetStatus
    from ..machine.manifest import Asset

#: The models of other commands may be missing.
_NEEDED = "reconstruct"


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "models",
        run,
        "list, fetch and verify the model files, add a head model",
        "The model files unlit reads but does not ship: what they are, where they are, and under "
        "which licence. They are fetched by the first run; for a machine without network, fetch "
        "them elsewhere and name their folder in the environment variable UNLIT_MODELS. "
        "`add ict FOLDER` makes a second head model of a copy of the public repository "
        "github.com/ICT-VGL/ICT-FaceKit (MIT licence), for `unlit reconstruct --model ict`.",
        "  unlit models\n  unlit models fetch\n  unlit models licences\n"
        "  unlit models add ict ICT-FaceKit/FaceXModel",
    )
    parser.add_argument(
        "action",
        nargs="?",
        choices=("list", "fetch", "verify", "licences", "add"),
        default="list",
        help="list (default); fetch what is missing; verify (exit code 1 if one is damaged, "
        "or if `reconstruct` lacks one); licences; add a head model",
    )
    parser.add_argument("name", nargs="?", metavar="ict", help="with add: the head model's name")
    parser.add_argument(
        "folder", type=user_path, nargs="?", metavar="FOLDER", help="with add: its files"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from ..machine import assets

    if options.action == "add":
        return _add(options, options.name, options.folder)
    if options.name is not None:
        raise SettingsError(f"{options.name}: has no use with {options.action}; leave it out")
    if options.action == "fetch":
        fetch()
    if options.action == "licences":
        answer(options, _licences(), models=[_entry(entry) for entry in assets.ASSETS.values()])
        return 0
    from ..head.files import added

    found, others = assets.statuses(), added()
    answer(
        options,
        _statuses(found, others, options.action == "verify"),
        models=[{**_entry(s.asset), "path": s.path, "problem": s.problem} for s in found],
        added=[{"name": name, "path": path} for name, path in others.items()],
    )
    bad = any(s.problem and (s.path is not None or s.asset.command == _NEEDED) for s in found)
    return int(bad and options.action == "verify")


def _entry(entry: Asset) -> dict[str, Any]:
    """What is known of a model file, for scripts."""
    names = ("name", "purpose", "size", "sha256", "licence", "licence_url", "origin", "command")
    return {name: getattr(entry, name) for name in names}


def _licences() -> str:
    from ..machine import assets

    return "\n".join(
        f"{entry.name}\n  {entry.purpose}\n  {entry.licence}: {entry.licence_url}\n"
        f"  from {entry.origin}"
        for entry in assets.ASSETS.values()
    )


def _statuses(found: list[AssetStatus], added: dict[str, Path], with_sums: bool) -> str:
    lines: list[str] = []
    for status in found:
        entry = status.asset
        optional = "" if entry.command == _NEEDED else f" (only `unlit {entry.command}` needs it)"
        lines += [
            f"{entry.name}  {entry.size / 1e6:.1f} MB  {entry.licence}",
            f"  {entry.purpose}",
            f"  {status.problem + optional if status.problem else f'verified: {status.path}'}",
        ]
        if with_sums:
            lines.append(f"  sha256 {entry.sha256}")
    for name, path in added.items():
        lines += [f"{name}  head model, for --model {name}", f"  {path}"]
    if any(status.problem for status in found):
        lines.append("`unlit models fetch` gets what is missing.")
    return "\n".join(lines)


def _add(options: argparse.Namespace, name: str | None, folder: str | None) -> int:
    """Make a head model of the files in `folder`."""
    if name is None or folder is None:
        raise SettingsError("name the model and its files, as in: unlit models add ict FOLDER")
    from ..head.sources import library
    from ..progress.console import StepConsole

    with StepConsole() as progress:
        path = library.add(name, Path(folder), progress)
    answer(options, path, file=path)
    return 0


def fetch(*commands: str) -> None:
    """Fetch what is missing of the models that `commands` need, or of all."""
    from ..machine import assets
    from ..progress.console import FetchConsole

    with FetchConsole() as progress:
        for name, entry in assets.ASSETS.items():
            if not commands or entry.command in commands:
                assets.asset(name, progress)
