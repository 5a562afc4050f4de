"""`unlit doctor`: what works on this machine."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .answer import add_json, answer
from .parser import command

if TYPE_CHECKING:
    from ..machine.doctor import Check


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "doctor",
        run,
        "say what works on this machine and how to mend what does not",
        "Look at Python, the renderer, its back end, all libraries, the models, memory, disk and "
        "extras. What cannot be loaded or does not work is told in a line with the remedy.",
        "  unlit doctor",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from ..machine.doctor import checks, looked, report

    found = [*checks(), *looked("viewer", lambda: [_viewer()])]
    ok = all(check.ok for check in found)
    answer(options, report(found), ok=ok, checks=[asdict(check) for check in found])
    return int(not ok)


def _viewer() -> Check:
    """All else works without it."""
    from ..machine.doctor import Check
    from ..report.bundle import REMEDY, missing_because, program

    if program() is not None:
        return Check("viewer", True, "in the reports")
    return Check("viewer", True, f"not in the reports: {missing_because()}", REMEDY)
