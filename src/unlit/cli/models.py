"""`unlit models`: list, fetch and verify the model files."""

from __future__ import annotations

import argparse
from typing import Any

from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "models",
        run,
        "list, fetch and verify the model files",
        "The model files unlit reads but does not ship: what they are, where they are, and under "
        "which licence. They are fetched by the first run; for a machine without network, fetch "
        "them elsewhere and name their folder in the environment variable UNLIT_MODELS.",
        "  unlit models\n  unlit models fetch\n  unlit models licences",
    )
    parser.add_argument(
        "action",
        nargs="?",
        choices=("list", "fetch", "verify", "licences"),
        default="list",
        help="list (default); fetch what is missing; verify (exit code 1 if one is bad); licences",
    )


def run(options: argparse.Namespace) -> int:
    from .. import assets

    if options.action == "fetch":
        fetch()
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


def fetch(*commands: str) -> None:
    """Fetch what is missing of the models that `commands` need, or of all."""
    from .. import assets
    from ..console import FetchConsole

    progress = FetchConsole()
    for name, entry in assets.ASSETS.items():
        if not commands or entry.command in commands:
            assets.asset(name, progress)
