"""`unlit cite`: what to cite for a result."""

from __future__ import annotations

import argparse
from typing import Any

from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "cite",
        run,
        "say what to cite for a result: paper, software, models, scans",
        "The works that a result of unlit stands on, and when each is to be cited: the paper, "
        "unlit, the renderer, the landmarker, the head models, the metrics and the scans of "
        "`unlit evaluate`.",
        "  unlit cite\n  unlit cite --bibtex > unlit.bib",
    )
    parser.add_argument("--bibtex", action="store_true", help="as BibTeX entries, UTF-8")


def run(options: argparse.Namespace) -> int:
    from ..machine.citations import bibtex, citations, in_words

    for entry in citations():
        if options.bibtex:
            print(f"% {entry.use}\n{bibtex(entry)}\n")
        else:
            print(f"{entry.use}\n  {in_words(entry)}")
    return 0
