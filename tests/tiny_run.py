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
from unlit.face.conditions import Conditions
from unlit.face.face import PosedMesh
from unlit.face.gain import AlbedoGain
from unlit.face.head import FittedHead
from unlit.face.photo import FacePhoto
from unlit.face.reconstruction import Reconstruction
from unlit.optimize.checkpoint import Checkpoint
from unlit.optimize.observation import observation
from unlit.optimize.problem import Problem
from unlit.optimize.run_record import RunRecord
from unlit.output.arrays import write_arrays
from unlit.perception.regions import Regions
from unlit.perception.topology import FACE_OVAL
from unlit.photo.crop import Crop
from unlit.pipeline.chain import Preview, Steps, run_chain
from unlit.pipeline.identity import identity_of
from unlit.scene.surface_points import SurfacePoints
from unlit.settings.conditions import CastShadow
from unlit.settings.settings import Settings, override
from unlit.settings.sun import SunSearch
from unlit.settings.tint import TintSearch
from unlit.storage.identity import Identity

SIZE = 32


def settings(**changes: object) -> Settings:
    """Three refreshes in every stage; the mesh moves far enough for its rays to be traced anew.

    The resolution, of which only `observe` takes notice, is the default: SIZE is no valid one.
    """
    short = Settings(
        refresh_interval=2,
        light_points=150,
        retrace_distance=0.001,
        cast_shadow=CastShadow(mode="keep"),
        sun=SunSearch(mode="never"),
        tint=TintSearch(mode="never"),
    )
    stages = {f"stage{k}": replace(getattr(short, f"stage{k}"), iterations=5) for k in range(1, 6)}
    return override(replace(short, **stages), changes)


def photo(seed: int = 1) -> FacePhoto:
    """A head lit from the upper left, noise for skin."""
    rng = np.random.default_rng(seed)
    ys, xs = (np.mgrid[0:SIZE, 0:SIZE] + 0.5) / SIZE
    colour = np.array([0.5, 0.35, 0.3]) * (1.1 - 0.5 * xs - 0.3 * ys)[..., None]
    image = (colour + rng.uniform(0, 0.03, colour.shape)).astype(np.float32)
    weights = np.zeros((SIZE, SIZE, 6), np.float32)
    weights[..., 0] = np.clip(1.6 - 4 * np.hypot(xs - 0.5, ys - 0.5), 0, 1)
    weights[..., 1] = weights[..., 0] * (ys > 0.65)
    weights[..., 0] -= weights[..., 1]
    weights[..., 5] = 1 - weights[..., :5].sum(axis=-1)
    # A round face about the crop's centre, its hairline at angle 0.
    landmarks = np.full((478, 3), SIZE / 2)
    angle = np.linspace(0, 2 * np.pi, len(FACE_OVAL), endpoint=False)
    around = np.stack([np.sin(angle), -np.cos(angle), 0 * angle], axis=1)
    landmarks[list(FACE_OVAL)] += 0.4 * SIZE * around
    crop = Crop(np.eye(2, 3), SIZE)
    return FacePhoto("tiny.png", image, camera(SIZE), crop, Regions(weights), landmarks)


def head() -> FittedHead:
    """The mesh, with a landmark near the first corner of each of its first five triangles."""
    vertices, triangles = bumpy_head(3)
    posed = PosedMesh(vertices, triangles, np.zeros((1, 2), np.float32), np.zeros_like(triangles))
    landmarks = (camera(SIZE).project(vertices[triangles[:5, 0]]) + 0.7).astype(np.float32)
    at_corner = np.eye(1, 3, dtype=np.float32).repeat(5, axis=0)
    return FittedHead(posed, landmarks, SurfacePoints(np.arange(5, dtype=np.int32), at_corner))


def steps(
    seen: FacePhoto | None = None,
    fitted: FittedHead | None = None,
    conditions: Conditions | None = None,
) -> Steps:
    """Steps that give what is known: `photo()`, `head()` and white light, or others."""
    known = seen or photo(), fitted or head(), conditions or Conditions()
    return Steps(lambda _: known[0], lambda *_: known[1], lambda *_: known[2])


def identity(name: str, chosen: Settings | None = None) -> Identity:
    """Whose result it is."""
    return identity_of(name, name, chosen or settings(), "", "only")


def run(
    checkpoint: Checkpoint | None = None,
    chosen: Settings | None = None,
    name: str = "tiny.png",
    known: Steps | None = None,
    preview: Preview | None = None,
) -> Reconstruction:
    """The result; the state is kept in `checkpoint`."""
    chosen = chosen or settings()
    if checkpoint is not None:
        checkpoint.belongs_to(identity(name, chosen))
    return run_chain(known or steps(), chosen, record(), checkpoint, preview)


def record() -> RunRecord:
    """A new one, that tells nobody."""
    return RunRecord(lambda *_: None)


def problem(
    chosen: Settings | None = None, report: RunRecord | None = None, **changes: np.ndarray
) -> Problem:
    """What the stages get; changes: fields of the observation that differ."""
    seen = replace(observation(photo(), head(), Conditions()), **changes)
    return Problem(seen, chosen or settings(), AlbedoGain(), report or record())


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    result = run(Checkpoint(folder / "state.npz", resume="--resume" in sys.argv))
    write_arrays(result, folder / "part.npz")
    (folder / "part.npz").rename(folder / "done.npz")
