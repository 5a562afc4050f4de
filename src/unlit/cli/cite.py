"""`unlit cite`: what to cite for a result."""

from __future__ import annotations

import argparse
from typing import Any

from .answer import add_json, answer
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
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from ..machine.citations import bibtex, citations, in_words

    entries = citations()
    if options.bibtex:
        texts = [f"% {entry.use}\n{bibtex(entry)}\n" for entry in entries]
    else:
        texts = [f"{entry.use}\n  {in_words(entry)}" for entry in entries]
    found = [{"use": x.use, "text": in_words(x), "bibtex": bibtex(x)} for x in entries]
    answer(options, "\n".join(texts), citations=found)
    return 0
