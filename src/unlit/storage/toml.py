"""TOML files from anywhere: bounded in size, and in the time that reading them takes."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

MAX_BYTES = 1 << 20
#: In one line. The parser's time grows with the square of a dotted key's parts.
_MAX_DOTS = 200


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of `path`.

    Raises OSError where it cannot be read, ValueError where it is no TOML of a sensible size.
    """
    with path.open("rb") as file:
        content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise ValueError(f"more than {MAX_BYTES >> 20} MB")
    if any(line.count(b".") > _MAX_DOTS for line in content.splitlines()):
        raise ValueError("a line of too many dots")
    try:
        return tomllib.loads(content.decode())
    except RecursionError as error:
        raise ValueError("nested too deep") from error
