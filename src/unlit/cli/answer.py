"""What a command prints on standard output: for people, or with --json one object for scripts.

Progress, warnings and hints go to standard error in either case. An error under --json is an
object, too: {"error": "one line", "code": exit code}.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json to a command that ends with `answer`."""
    parser.add_argument(
        "--json",
        action="store_true",
        help="print one JSON object on standard output, for scripts; on an error, one with "
        '"error" and "code"',
    )


def answer(options: argparse.Namespace, words: object, **fields: Any) -> None:
    """Print `words`, or with --json `fields` and the seconds that the command took."""
    if not options.json:
        print(words)
        return
    seconds = round(time.monotonic() - options.began, 3)
    print_object({"command": options.command, **fields, "seconds": seconds})


def print_object(fields: dict[str, Any]) -> None:
    """Print `fields` as JSON, in one line. Paths are absolute; there are no NaNs."""
    print(json.dumps(fields, default=_plain, allow_nan=False))


def _plain(value: object) -> str:
    if isinstance(value, Path):
        return str(value.absolute())
    raise TypeError(f"{type(value).__name__} in an answer")
