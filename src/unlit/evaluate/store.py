"""Finished steps of an evaluation, kept by content so that none is done twice.

A step's key is a hash of everything that decides its result: its inputs, its settings, and the
source code it runs through. An interrupted evaluation continues with the first step it has not.
"""

from __future__ import annotations

import functools
import hashlib
import io
import json
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import OutputError
from ..output import load, save, write_one
from ..reconstruction import Reconstruction

_PACKAGE = Path(__file__).resolve().parents[1]
#: The code that decides a path-traced picture, and that which decides a reconstruction.
RENDERING = (
    "render",
    "scene",
    "color.py",
    "evaluate/meshes.py",
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
    "head",
    "icc.py",
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


Busy = Callable[[str], AbstractContextManager[Any]]


class Store:
    """A folder of finished steps. `busy` is entered with a step's name while it is being done."""

    def __init__(self, folder: Path, busy: Busy = nullcontext) -> None:
        self.folder, self.busy = folder, busy
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{folder}: cannot be made ({error.strerror})") from error

    def picture(self, name: str, content: str, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The array that `make` returns, float32."""
        path = self.folder / f"{name}-{content}.npy"
        try:
            return np.load(path, allow_pickle=False)
        except FileNotFoundError:
            pass
        except (OSError, ValueError, EOFError):
            path.unlink(missing_ok=True)
        with self.busy(name):
            image = np.asarray(make(), dtype=np.float32)
        stream = io.BytesIO()
        np.save(stream, image, allow_pickle=False)
        write_one(path, stream.getvalue())
        return image

    def reconstruction(
        self, name: str, content: str, make: Callable[[], Reconstruction]
    ) -> Reconstruction:
        """The result of `make`, which says itself how far it is; kept as a result's folder."""
        folder = self.folder / f"{name}-{content}"
        try:
            return load(folder)
        except OutputError:
            pass
        result = make()
        with self.busy(f"saving {name}"):
            save(result, folder)
        return result

    def values(self, name: str, content: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The plain values that `make` returns."""
        path = self.folder / f"{name}-{content}.json"
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            pass
        except (OSError, ValueError):
            path.unlink(missing_ok=True)
        with self.busy(name):
            values = make()
        write_one(path, json.dumps(values, indent=1).encode())
        return values
