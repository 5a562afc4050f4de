"""The viewer's program: three.js and viewer/src in one file, made when unlit is built."""

from __future__ import annotations

from pathlib import Path

WEB = Path(__file__).parent / "web"
_PROGRAM = WEB / "viewer.js"
#: Written by hatch_build.py instead of the program when it could not be made.
_REASON = WEB / "viewer.missing.txt"
REMEDY = (
    "where npm has a network, run `pip install --force-reinstall --no-deps .` in unlit's "
    "source folder, then `unlit report DIR`"
)


def program() -> str | None:
    """The script, or None where the build could not make it."""
    return _PROGRAM.read_text(encoding="utf-8") if _PROGRAM.is_file() else None


def missing_because() -> str:
    """Why there is no program, one line."""
    if _REASON.is_file():
        return " ".join(_REASON.read_text(encoding="utf-8").split())
    return "unlit runs from a source folder in which it was never built"
