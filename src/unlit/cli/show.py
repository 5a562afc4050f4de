"""`unlit montage`, `report` and `view`: what shows a saved result."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import SettingsError
from .answer import add_json, answer
from .arguments import user_path
from .parser import command, whole_number

_COMPARISON = "unlit-comparison.html"


def add(commands: Any) -> None:
    """The sub-parsers of these commands."""
    montage = command(
        commands,
        "montage",
        run_montage,
        "draw a result's overview picture anew",
        "Draw DIR/montage.png of a saved result anew and print its path: photo, render, error, "
        "maps, light, mesh, and the face under three new lights.",
        "  unlit montage portrait",
    )
    report = command(
        commands,
        "report",
        run_report,
        "write a result's report anew, or compare two results on one page",
        "Write DIR/report.html of a saved result anew and print its path. The page needs no "
        "network and no other file: photo, maps, stages, losses, settings, and the head in three "
        "dimensions under lights that you choose. Given a second folder, OTHER, write one page "
        "with both results side by side and say what differs.",
        "  unlit report portrait\n  unlit report portrait portrait-draft -o compared.html",
    )
    view = command(
        commands,
        "view",
        run_view,
        "look at a result in the browser",
        "Serve DIR/report.html and the result's other files to this machine only, print the "
        "address and open the browser; Ctrl-C ends it. The report is written first if there is "
        "none. Without a server: open DIR/report.html from disk.",
        "  unlit view portrait\n  unlit view portrait --no-browser --port 8000",
    )
    for parser in (montage, report):
        add_json(parser)
    for parser in (montage, report, view):
        parser.add_argument(
            "folder",
            type=user_path,
            metavar="DIR",
            help="a folder that `unlit reconstruct` wrote",
        )
    report.add_argument(
        "other", type=user_path, metavar="OTHER", nargs="?", help="another, to compare DIR with"
    )
    report.add_argument(
        *("-o", "--output"),
        type=user_path,
        metavar="FILE",
        help=f"page to write, of two results ({_COMPARISON})",
    )
    view.add_argument("--no-browser", action="store_true", help="only print the address")
    port = whole_number(0, 65535)
    view.add_argument(
        "--port", type=port, default=0, metavar="N", help="to listen on (a random free one)"
    )


def run_montage(options: argparse.Namespace) -> int:
    from ..output.load import load
    from ..output.montage import montage_png
    from ..storage.folder import write_one

    path = Path(options.folder) / "montage.png"
    write_one(path, montage_png(load(options.folder)))
    answer(options, path, file=path)
    return 0


def run_report(options: argparse.Namespace) -> int:
    from ..progress.console import StepConsole
    from ..report.comparison import write_comparison
    from ..report.page import write_report

    if options.other is None and options.output is not None:
        raise SettingsError("-o has a use with two folders only; leave it out, or name OTHER")
    with StepConsole() as progress:
        if options.other is None:
            path = write_report(options.folder, progress)
        else:
            folders = Path(options.folder), Path(options.other)
            path = write_comparison(folders, Path(options.output or _COMPARISON), progress)
    answer(options, path, file=path)
    return 0


def run_view(options: argparse.Namespace) -> int:
    import contextlib
    import webbrowser

    from ..progress.console import StepConsole
    from ..report.page import REPORT, write_report
    from ..report.server import ReportServer

    folder = Path(options.folder)
    if not (folder / REPORT).is_file():
        with StepConsole() as progress:
            write_report(folder, progress)
    with ReportServer(folder, options.port) as server:
        print(server.address, flush=True)
        if not options.no_browser:
            webbrowser.open(server.address)
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0
