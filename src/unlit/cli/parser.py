"""What the parsers of all commands share."""

from __future__ import annotations

import argparse
import re
from typing import Any


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
    parser.set_defaults(run=run, again=", run it again")
    return parser
