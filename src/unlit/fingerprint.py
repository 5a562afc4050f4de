"""Fingerprints: of arrays and plain values, and of the source code that decides a result.

What is kept of an earlier run (checkpoints, steps of an evaluation) is used again only if the
fingerprint of all that decided it is the same.
"""

from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGE = Path(__file__).resolve().parent
#: The code that decides a path-traced picture, and that which decides a reconstruction.
RENDERING = (
    "render",
    "scene",
    "color.py",
    "meshes.py",
    "pictures.py",
    "evaluate/scan.py",
    "evaluate/subject.py",
    "evaluate/subject_file.py",
    # A frontal subject is framed by the landmarks found on it.
    "assets.py",
    "perception",
    "photo.py",
)
RECONSTRUCTION = (
    "assets.py",
    "color.py",
    "exposure.py",
    "head",
    "icc.py",
    "illuminant.py",
    "mask.py",
    "optimize",
    "perception",
    "photo.py",
    "pipeline.py",
    "reconstruction.py",
    "render",
    "scene",
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
        inside = (_PACKAGE / part).glob("*")
        kept = sorted(file for file in inside if file.suffix in (".py", ".npz"))
        files += [_PACKAGE / part] if part.endswith(".py") else kept
    return key(*(file.read_bytes() for file in files))
