"""`unlit doctor`: what works on this machine."""

from __future__ import annotations

import argparse
from typing import Any

from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    command(
        commands,
        "doctor",
        run,
        "say what works on this machine and how to mend what does not",
        "Look at Python, the renderer, its back end, the models, memory and disk.",
        "  unlit doctor",
    )


def run(options: argparse.Namespace) -> int:
    from ..machine.doctor import checks

    found = checks()
    width = max(len(check.name) for check in found)
    for check in found:
        print(f"{'ok ' if check.ok else 'BAD'}  {check.name:<{width}}  {check.detail}")
        if check.remedy:
            print(f"     {'':<{width}}  -> {check.remedy}")
    return int(not all(check.ok for check in found))
