"""A reconstruction that takes no time worth speaking of, for tests of what a batch does around it.

`install` puts it in place of `unlit.pipeline.chain.reconstruct` and `unlit.output.save.save`;
loaded by `dask worker --preload`, this file installs itself, told how by the environment. The
photo's first pixel says what happens: red raises an error that is no user's, green ends the
process.
"""

from __future__ import annotations

import os
import sys
import time
import types
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import unlit
import unlit.output.save
from unlit.face.reconstruction import Metrics
from unlit.photo.photo import Photo
from unlit.storage.folder import MARK, MARK_TEXT, write_all

LOG, SECONDS = "UNLIT_TEST_LOG", "UNLIT_TEST_SECONDS"


def install(log: Path, seconds: float = 0.0, patch: Any = None) -> None:
    """Every result takes `seconds`; begins and ends are noted in `log`, a line each."""

    def note(what: str, source: str) -> None:
        with log.open("a") as file:
            file.write(f"{what} {source} {os.getpid()} {time.time()}\n")

    def reconstruct(photo: Photo, *, settings: Any, face: Any, model: Any, progress: Any) -> Any:
        note("begin", photo.source)
        red, green, blue = photo.pixels[0, 0]
        if red > 0.9 and max(green, blue) < 0.1:
            raise ZeroDivisionError("no light")
        if green > 0.9 and max(red, blue) < 0.1:
            os._exit(1)
        for step in range(10):
            progress("stage1", step, 10, 0.5)
            time.sleep(seconds / 10)
        note("end", photo.source)
        return types.SimpleNamespace(
            images=types.SimpleNamespace(render=photo.pixels),
            photo=types.SimpleNamespace(image=photo.pixels * 0.9),
            face=types.SimpleNamespace(mask=np.ones(photo.pixels.shape[:2])),
            head=types.SimpleNamespace(landmark_residual=0.02),
            content=f"{photo.source} {face} {settings.resolution}",
            metrics=Metrics(
                losses={"stage1": [(0, 0.9), (9, 0.5)]},
                seconds={"photo": 0.1, "stage1": seconds},
                peak_memory_mb=700.0,
                warnings=("the face is small",),
            ),
        )

    def save(result: Any, folder: Path, log: str = "", pages: Any = None) -> None:
        texts = {MARK: f"{MARK_TEXT} {result.content}", "montage.png": "x", "run.log": log}
        write_all(
            folder, {name: lambda path, t=text: path.write_text(t) for name, text in texts.items()}
        )

    pipeline = types.ModuleType("unlit.pipeline.chain")
    pipeline.reconstruct = reconstruct  # type: ignore[attr-defined]
    if patch is None:
        sys.modules["unlit.pipeline.chain"] = pipeline
        unlit.output.save.save = save  # type: ignore[assignment]
    else:
        patch.setitem(sys.modules, "unlit.pipeline.chain", pipeline)
        patch.setattr(unlit, "pipeline", pipeline, raising=False)
        patch.setattr(unlit.output.save, "save", save)


def picture(path: Path, colour: tuple[int, int, int] = (128, 128, 128)) -> Path:
    """A photo of one colour, whatever its name ends with."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((64, 64, 3), colour, np.uint8)).save(path, "PNG")
    return path


def noted(log: Path, what: str) -> list[str]:
    """The photos whose begin or end was noted, in order."""
    lines = [line.split() for line in log.read_text().splitlines()] if log.exists() else []
    return [words[1] for words in lines if words[0] == what]


if LOG in os.environ:
    install(Path(os.environ[LOG]), float(os.environ[SECONDS]))
