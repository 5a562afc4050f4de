"""`unlit montage`: a saved result's overview picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "montage",
        run,
        "draw a result's overview picture anew",
        "Draw DIR/montage.png of a saved result anew and print its path: photo, render, error, "
        "maps, light, mesh, and the face under three new lights.",
        "  unlit montage portrait",
    )
    parser.add_argument("folder", metavar="DIR", help="a folder that `unlit reconstruct` wrote")


def run(options: argparse.Namespace) -> int:
    from ..output import load, montage_png, write_one

    path = Path(options.folder) / "montage.png"
    write_one(path, montage_png(load(options.folder)))
    print(path)
    return 0
