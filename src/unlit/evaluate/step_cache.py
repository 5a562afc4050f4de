"""Finished steps of an evaluation, kept by content so that none is done twice.

A step's key is a hash of everything that decides its result: its inputs, its settings, and the
source code it runs through. An interrupted evaluation continues with the first step it has not.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import OutputError
from ..face.reconstruction import Reconstruction
from ..output.load import load
from ..output.save import save
from ..storage.folder import write_one

Busy = Callable[[str], AbstractContextManager[Any]]


class StepCache:
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
