"""What the parsers of all commands share."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable
from typing import Any

from ..errors import SettingsError

#: What options are that were not given, where that is neither None nor False.
_UNSAID = {"preset": "standard", "face": "only"}


def command(
    commands: Any, name: str, run: Any, summary: str, description: str, examples: str
) -> argparse.ArgumentParser:
    """Add the command `name` to `commands`; `run` takes its options and returns the exit code."""
    import textwrap

    parser = commands.add_parser(
        name,
        help=summary,
        description=textwrap.fill(description, 90),
        epilog=f"example{'s' if examples.count('unlit ') > 1 else ''}:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    # What begins like a number is a value, as from Python 3.14 on: -30,10 is no option.
    parser._negative_number_matcher = re.compile(r"-\.?\d")
    parser.set_defaults(run=run, command=name, again=", run it again")
    return parser


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """The type of an argument that is a number from `low` to `high`, written in digits."""

    def read(text: str) -> int:
        if text.isdecimal() and low <= int(text) <= high:
            return int(text)
        raise argparse.ArgumentTypeError(f"{text!r}: write a number from {low} to {high}")

    return read


def refuse_unused(options: argparse.Namespace, names: Iterable[str], kind: str) -> None:
    """Raise SettingsError where one of the options `names`, of no use with `kind`, was given."""
    for name in names:
        value = getattr(options, name)
        if value is not False and value != _UNSAID.get(name):  # a number may be 0, which is given
            spelt = "PHOTO" if name == "photo" else f"--{name.replace('_', '-')}"
            raise SettingsError(f"{spelt} has no use with {kind}; leave it out")
