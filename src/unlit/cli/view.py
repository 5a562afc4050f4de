"""`unlit view`: a saved result in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "view",
        run,
        "look at a result in the browser",
        "Serve DIR/report.html and the result's other files to this machine only, print the "
        "address and open the browser; Ctrl-C ends it. The report is written first if there is "
        "none. Without a server: open DIR/report.html from disk.",
        "  unlit view portrait\n  unlit view portrait --no-browser --port 8000",
    )
    parser.add_argument("folder", metavar="DIR", help="a folder that `unlit reconstruct` wrote")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    parser.add_argument(
        "--port", type=_port, default=0, metavar="N", help="to listen on (a random free one)"
    )


def run(options: argparse.Namespace) -> int:
    import contextlib
    import webbrowser

    from ..report.page import REPORT, write_report
    from ..report.server import ReportServer

    folder = Path(options.folder)
    if not (folder / REPORT).is_file():
        write_report(folder)
    with ReportServer(folder, options.port) as server:
        print(server.address, flush=True)
        if not options.no_browser:
            webbrowser.open(server.address)
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0


def _port(text: str) -> int:
    if text.isdecimal() and int(text) < 1 << 16:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r}: write a number from 0 to 65535")
