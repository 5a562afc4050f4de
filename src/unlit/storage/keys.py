"""Fingerprints: of arrays and plain values, and of the source code that decides a result.

What is kept of an earlier run (checkpoints, steps of an evaluation) is used again only if the
fingerprint of all that decided it is the same.
"""

# pyright: basic
from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGE = Path(__file__).resolve().parents[1]
#: The modules and sub-packages that decide a reconstruction; all others only show or store it.
RECONSTRUCTION = (
    "color.py",
    "conditions",
    "face",
    "fit",
    "head",
    "machine",
    "optimize",
    "perception",
    "photo",
    "pipeline",
    "render",
    "scene",
    "settings",
    "storage",
)
#: Those that decide a path-traced picture; a frontal subject is framed by the landmarks found on
#: it.
RENDERING = (
    "color.py",
    "evaluate",
    "machine",
    "perception",
    "photo",
    "render",
    "scene",
    "storage",
)


def key(*parts: Any) -> str:
    """16 hexadecimal digits of the content of arrays, bytes and plain values."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype.str}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        elif isinstance(part, bytes):
            digest.update(part)
        else:
            digest.update(json.dumps(part, sort_keys=True, default=str).encode())
        digest.update(b"\0")
    return digest.hexdigest()[:16]


@functools.cache
def code(parts: tuple[str, ...]) -> str:
    """Key of the source files of these modules and sub-packages of unlit, and of their data."""
    files: list[Path] = []
    for part in parts:
        inside = (_PACKAGE / part).rglob("*")
        kept = sorted(file for file in inside if file.suffix in (".py", ".npz", ".toml"))
        files += [_PACKAGE / part] if part.endswith(".py") else kept
    return key(*(file.read_bytes() for file in files))
