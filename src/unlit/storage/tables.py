"""Tables of plain values (TOML, JSON) from anywhere: bounded in size, and checked by types.

A file's content is described by a dataclass whose annotations are the checks.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from ..errors import UnlitError

Content = TypeVar("Content")

MAX_BYTES = 1 << 20
#: In one line. The parser's time grows with the square of a dotted key's parts.
_MAX_DOTS = 200
_HEADER = re.compile(r"(\[\[?)([^\[\]]+)\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"([\w\"'](?:[\w.\"' \t-]{0,200}?))\s*=")
_FIELD = re.compile(r"Object (missing required|contains unknown) field `(.*)`")


def read_bytes(path: Path, error: type[UnlitError], limit: int) -> bytes:
    """The content of `path`. Raises `error` where it cannot be read or has more than `limit`."""
    try:
        with path.open("rb") as file:
            content = file.read(limit + 1)
    except (OSError, ValueError) as cause:  # ValueError: a null character in its name
        why = getattr(cause, "strerror", None) or cause
        raise error(f"{path}: cannot be read ({why})") from cause
    if len(content) > limit:
        raise error(f"{path}: more than {limit >> 20} MB")
    return content


def read_toml(path: Path, error: type[UnlitError]) -> dict[str, Any]:
    """The tables of `path`. Raises `error` where it is no TOML of a sensible size."""
    content = read_bytes(path, error, MAX_BYTES)
    try:
        if any(line.count(b".") > _MAX_DOTS for line in content.splitlines()):
            raise ValueError("a line of too many dots")
        return tomllib.loads(content.decode())
    except RecursionError as cause:
        raise error(f"{path}: no valid TOML (nested too deep)") from cause
    except ValueError as cause:
        raise error(f"{path}: no valid TOML ({cause})") from cause


def place_of(path: Path, name: str) -> str:
    """Where the field `name`, as `typed` names it, stands in a TOML file: "FILE, line 7".

    Where it does not stand in a line of its own, as "crop.matrix[0]" or a field that is missing,
    the line of what it is part of; without a number where that is not there either.
    """
    lines = _lines(path)
    while name:
        if line := lines.get(name):
            return f"{path}, line {line}"
        name = name[: max(name.rfind("."), name.rfind("["), 0)]
    return str(path)


def _lines(path: Path) -> dict[str, int]:
    """The lines of a TOML file, from 1, in which tables and fields begin, by name."""
    found: dict[str, int] = {}
    arrays: dict[str, int] = {}
    table = ""
    for number, line in enumerate(path.read_bytes()[:MAX_BYTES].splitlines(), 1):
        text = line.decode(errors="replace").strip()
        if header := _HEADER.match(text):
            table = _plain(header[2])
            if header[1] == "[[":
                arrays[table] = arrays.get(table, -1) + 1
            first, dot, rest = table.partition(".")
            if first in arrays:  # the latest of them
                table = f"{first}[{arrays[first]}]{dot}{rest}"
            found.setdefault(table, number)
        elif key := _KEY.match(text):
            found.setdefault(".".join(filter(None, [table, _plain(key[1])])), number)
    return found


def _plain(key: str) -> str:
    """A key without its quotes and spaces."""
    return ".".join(part.strip(" \t\"'") for part in key.split("."))


def array(kind: Any, value: Any) -> np.ndarray:
    """For `typed`: nested lists of numbers as float64. Raises ValueError or TypeError."""
    if kind is not np.ndarray:
        raise TypeError(f"no values of type {kind}")
    try:
        return np.array(value, dtype=np.float64)
    except (OverflowError, ValueError) as error:
        raise ValueError("must be numbers, in rows of the same length") from error


def typed(values: Any, kind: type[Content], decode: Callable[[Any, Any], Any] = array) -> Content:
    """Plain `values` as a `kind`: a dataclass or whatever msgspec knows.

    decode: called with other types of fields, and the value. Raises ValueError, one line: the
    dotted field and what is wrong with it.
    """
    try:
        return msgspec.convert(values, kind, dec_hook=decode)
    except (msgspec.ValidationError, OverflowError, RecursionError) as error:
        raise ValueError(explained(error)) from error


def explained(error: Exception) -> str:
    """What msgspec found wrong: "camera.width: Expected `int`, got `str`"."""
    text = " ".join(str(error).split())
    what, _, place = text.rpartition(" - at `$") if " - at `$" in text else (text, "", "")
    names = [place.strip(".`")] if place else []
    if field := _FIELD.fullmatch(what):
        names.append(field[2])
        what = "is missing" if field[1] == "missing required" else "is not a field here"
    return ": ".join(part for part in (".".join(filter(None, names)), what) if part)
