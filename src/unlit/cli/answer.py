"""What a command prints on standard output: for people, or with --json one object for scripts.

Progress, warnings and hints go to standard error in either case. An error under --json is an
object, too: {"error": "one line", "code": exit code}.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

_OPTION = "--json"


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json to a command that ends with `answer`."""
    parser.add_argument(
        _OPTION,
        action="store_true",
        help="print one JSON object on standard output, for scripts; on an error, one with "
        '"error" and "code"',
    )


def asked_for(arguments: Sequence[str]) -> bool:
    """Whether `arguments` hold --json, perhaps cut short as argparse allows.

    For errors of the arguments themselves, of which the parser then tells nothing.
    """
    return any(len(word) > 2 and _OPTION.startswith(word) for word in arguments)


def answer(options: argparse.Namespace, words: object, **fields: Any) -> None:
    """Print `words`, or with --json `fields` and the seconds that the command took."""
    if not options.json:
        print(words)
        return
    seconds = round(time.monotonic() - options.began, 3)
    print_object({"command": options.command, **fields, "seconds": seconds})


def print_object(fields: dict[str, Any]) -> None:
    """Print `fields` as JSON, in one line. Paths are absolute; numbers not finite are null."""
    print(json.dumps(_plain(fields), allow_nan=False))


def _plain(value: Any) -> Any:
    """`value` as JSON has it, which knows neither paths nor NaN and infinity."""
    if isinstance(value, Mapping):
        table = cast(Mapping[str, Any], value)
        return {name: _plain(inner) for name, inner in table.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in cast(Sequence[Any], value)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value.absolute()) if isinstance(value, Path) else value
