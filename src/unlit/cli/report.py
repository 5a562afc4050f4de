"""`unlit report`: one page that shows a saved result."""

from __future__ import annotations

import argparse
from typing import Any

from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "report",
        run,
        "write a result's report anew: one page with all maps and a viewer",
        "Write DIR/report.html of a saved result anew and print its path. The page needs no "
        "network and no other file: photo, maps, stages, losses, settings, and the head in three "
        "dimensions under lights that you choose.",
        "  unlit report portrait",
    )
    parser.add_argument("folder", metavar="DIR", help="a folder that `unlit reconstruct` wrote")


def run(options: argparse.Namespace) -> int:
    from ..report.page import write_report

    print(write_report(options.folder))
    return 0
