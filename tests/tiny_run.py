"""All five stages on a made-up head within seconds, for the tests of what surrounds them.

As a program it is a run that can be killed: `python tiny_run.py FOLDER [--resume]` keeps its state
in FOLDER and leaves FOLDER/done.npz.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
from bumpy_head import bumpy_head, camera
from unlit.face.reconstruction import Reconstruction
from unlit.optimize.checkpoint import Checkpoint
from unlit.output.arrays import write_arrays
from unlit.perception.regions import Regions
from unlit.photo.crop import Crop
from unlit.pipeline.chain import Capture, Head, solve
from unlit.settings.settings import Settings, override

SIZE = 32


def settings(**changes: object) -> Settings:
    """Three refreshes in every stage; the mesh moves far enough for its rays to be traced anew."""
    short = Settings(resolution=SIZE, refresh_interval=2, light_points=150, retrace_distance=0.001)
    stages = {f"stage{k}": replace(getattr(short, f"stage{k}"), iterations=5) for k in range(1, 6)}
    return override(replace(short, **stages), changes)


def capture(seed: int = 1) -> Capture:
    """A head lit from the upper left, noise for skin, five of its vertices as landmarks."""
    rng = np.random.default_rng(seed)
    ys, xs = (np.mgrid[0:SIZE, 0:SIZE] + 0.5) / SIZE
    colour = np.array([0.5, 0.35, 0.3]) * (1.1 - 0.5 * xs - 0.3 * ys)[..., None]
    image = (colour + rng.uniform(0, 0.03, colour.shape)).astype(np.float32)
    weights = np.zeros((SIZE, SIZE, 6), np.float32)
    weights[..., 0] = np.clip(1.6 - 4 * np.hypot(xs - 0.5, ys - 0.5), 0, 1)
    weights[..., 1] = weights[..., 0] * (ys > 0.65)
    weights[..., 0] -= weights[..., 1]
    weights[..., 5] = 1 - weights[..., :4].sum(axis=-1)
    seen = head().vertices[head().triangles[:5, 0]]
    landmarks = camera(SIZE).project(seen) + 0.7
    crop = Crop(np.eye(2, 3), SIZE)
    return Capture("tiny.png", image, camera(SIZE), crop, Regions(weights), landmarks)


def head() -> Head:
    """The mesh, with a landmark at the first corner of each of its first five triangles."""
    vertices, triangles = bumpy_head(3)
    uv = np.zeros((1, 2), np.float32)
    at_corner = np.eye(1, 3, dtype=np.float32).repeat(5, axis=0)
    layout = np.zeros_like(triangles)
    return Head(vertices, triangles, uv, layout, np.arange(5, dtype=np.int32), at_corner)


def run(
    checkpoint: Checkpoint | None = None, chosen: Settings | None = None, name: str = "tiny.png"
) -> Reconstruction:
    """The result; the state is kept in `checkpoint`."""
    chosen, seen = chosen or settings(), capture()
    if checkpoint is None:
        return solve(seen, head(), chosen)
    checkpoint.belongs_to((name, name), chosen, {"face": "only"})
    return solve(seen, head(), chosen, begin=checkpoint.begin, keep=checkpoint.keep)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    result = run(Checkpoint(folder / "state.npz", resume="--resume" in sys.argv))
    write_arrays(result, folder / "part.npz")
    (folder / "part.npz").rename(folder / "done.npz")
