"""The end of a stage, kept in a file, so that a run that was broken off can be resumed.

The stages are deterministic and hand each other NumPy arrays (`run_stages`): a run that reads them
from a file goes on as if nothing had happened. What comes before the stages takes seconds and is
done again; a stage that was broken off is done again from its start.
"""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ..errors import OutputError
from ..machine.runtime import mitsuba
from ..scene.arrays import device
from ..scene.cells import SphereCells
from ..settings.table1 import TABLE_1
from ..storage.arrays import Kind, check_indices, read_checked
from ..storage.folder import write_one
from ..storage.identity import Identity
from ..storage.keys import key
from ..storage.tables import typed
from .estimate import Estimate
from .observation import Observation
from .problem import Problem
from .run_record import RunRecord
from .shading import Shading
from .stages import Begin

mi = mitsuba()

_REMEDY = "start anew instead of resuming"
_ABOUT = {"about": Kind(("B",), "|u1")}
#: V, P: vertices and pixels of the problem; K lobes and D cells of the light.
_KINDS = {
    "vertices": Kind(("V", 3)),
    "log_diffuse": Kind(("P", 3)),
    "log_specular": Kind(("P",)),
    "perturbation": Kind(("P", 3)),
    "axis": Kind(("K", 3)),
    "log_sharpness": Kind(("K",)),
    "log_amplitude": Kind(("K",)),
    "pull": Kind(("P", 3)),
    "right": Kind(("P", 4)),
    "below": Kind(("P", 4)),
    "cell_theta": Kind(("D", 2), "<f8"),
    "cell_phi": Kind(("D", 2), "<f8"),
    "triangle": Kind(("P",), "<u4"),
    "diffuse_normal": Kind(("P", 3)),
    "specular_normal": Kind(("P", 3)),
}


@dataclass(frozen=True)
class _About:
    """The plain values of the file. stage: how many are done. observation: key of what was seen.
    losses, seconds: as in RunRecord. file: the photo's, "" if it has none.
    """

    stage: Annotated[int, msgspec.Meta(ge=0, le=len(TABLE_1))]
    identity: Identity
    observation: str
    losses: dict[str, list[tuple[int, float]]]
    seconds: dict[str, float]
    file: str = ""


class Checkpoint:
    """The file in which a run keeps its state, and from which it is resumed.

    path: its place, in the folder of the result to come. resume: go on from what is there, if
    anything is; otherwise it is discarded. file: the photo's, kept for who resumes without naming
    it. stage: how many stages are done.
    Raises OutputError when the file is to be read and cannot be.
    """

    def __init__(self, path: Path, resume: bool = False, file: str = "") -> None:
        self.path = path
        self._file = file
        self._identity: Identity | None = None
        self._observation = ""
        self._about = _read_about(path) if resume and path.exists() else None
        self.stage = self._about.stage if self._about else 0

    def belongs_to(self, identity: Identity) -> None:
        """Say whose state it is, before anything is computed.

        Raises OutputError of one line when the file is of another run.
        """
        self._identity = identity
        if self._about and (what := self._about.identity.difference(identity)):
            raise OutputError(f"{self.path.parent}: its unfinished run is of {what}; {_REMEDY}")

    def begin(self, problem: Problem, run: RunRecord) -> Begin | None:
        """Where to go on, with the problem's mesh put there; None: from the start.

        run: to which the seconds of the earlier run are added. Raises OutputError.
        """
        self._observation = _observation_key(problem.observation)
        if not self._about:
            self.discard()
            return None
        if self._about.observation != self._observation:
            raise OutputError(
                f"{self.path.parent}: in its unfinished run another face or head was found; "
                f"{_REMEDY}"
            )
        sizes = {"P": len(problem), "V": len(problem.observation.vertices)}
        found, _ = read_checked(self.path, _KINDS, sizes, remedy=_REMEDY)
        triangle = found.pop("triangle")
        check_indices(self.path, "triangle", triangle, len(problem.observation.triangles))
        cells = SphereCells(found.pop("cell_theta"), found.pop("cell_phi"))
        names = ("diffuse_normal", "specular_normal")
        diffuse, specular = (device(mi.Vector3f, found.pop(name)) for name in names)
        estimate = Estimate.of(found)
        for name, value in self._about.seconds.items():
            run.seconds[name] = run.seconds.get(name, 0.0) + value
        if self.stage >= 3:
            problem.place(estimate.vertices, triangle)
        return Begin(self.stage, estimate, cells, (diffuse, specular), self._about.losses)

    def keep(
        self, stage: str, problem: Problem, estimate: Estimate, shading: Shading, run: RunRecord
    ) -> None:
        """Put the end of `stage` in the place of what the file held. Raises OutputError."""
        assert self._identity is not None
        done = 1 + list(TABLE_1).index(stage)
        about = _About(done, self._identity, self._observation, run.losses, run.seconds, self._file)
        arrays = {
            **estimate.arrays(),
            "cell_theta": shading.cells.theta,
            "cell_phi": shading.cells.phi,
            "triangle": problem.hits.triangle.numpy(),
            "diffuse_normal": shading.points.diffuse_normal.numpy().T,
            "specular_normal": shading.points.specular_normal.numpy().T,
            "about": np.frombuffer(json.dumps(asdict(about)).encode(), np.uint8),
        }
        stream = io.BytesIO()
        np.savez(
            stream,
            allow_pickle=False,
            **{
                name: np.ascontiguousarray(arrays[name], kind.dtype)
                for name, kind in (_KINDS | _ABOUT).items()
            },
        )
        write_one(self.path, stream.getvalue())

    def discard(self) -> None:
        """Remove the file."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)


def photo_of_run(path: Path) -> str:
    """The photo's file that the unfinished run with the checkpoint `path` is of; "" if not kept.

    Raises OutputError.
    """
    return _read_about(path).file


def _observation_key(seen: Observation) -> str:
    names = ("image", "regions", "weight", "vertices", "triangles", "landmarks")
    return key(*(getattr(seen, name) for name in names), seen.skin_regions, vars(seen.camera))


def _read_about(path: Path) -> _About:
    """The plain values in the file. Raises OutputError."""
    found, _ = read_checked(path, _ABOUT, remedy=_REMEDY)
    try:
        return typed(json.loads(found["about"].tobytes()), _About)
    except (ValueError, RecursionError) as error:
        raise OutputError(f"{path}: about is damaged; {_REMEDY}") from error
