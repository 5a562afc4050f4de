"""The stages on one photo, from its fitted head to the last estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from threadpoolctl import threadpool_limits

from ..errors import FaceError
from ..face.conditions import Conditions
from ..face.gain import AlbedoGain
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..settings.settings import Settings
from ..settings.table1 import LAST_STAGE
from .estimate import Estimate
from .observation import observation
from .problem import Problem
from .run_record import RunRecord
from .shading import Shading
from .stages import Begin, run_stages, start


@dataclass(frozen=True)
class Solution:
    """What the stages, or those so far, have left; no shading before the first."""

    problem: Problem
    estimate: Estimate
    shading: Shading | None


class Keeper(Protocol):
    """Keeps the end of every stage, so that a run can begin there again."""

    def begin(self, problem: Problem, run: RunRecord) -> Begin | None:
        """What the stages go on from, with the problem's mesh put there; None: the start."""
        ...

    def keep(
        self, stage: str, problem: Problem, estimate: Estimate, shading: Shading, run: RunRecord
    ) -> None:
        """Called at the end of `stage`."""
        ...


def solve(
    photo: FacePhoto,
    head: FittedHead,
    conditions: Conditions,
    settings: Settings,
    run: RunRecord,
    keeper: Keeper | None = None,
    preview: Callable[[str, Solution], None] | None = None,
) -> Solution:
    """The five stages, starting from `head`, or from where `keeper` begins.

    preview: called with ("fit", the start) and after every stage but the last. Raises FaceError,
    and SettingsError where the patch of a known albedo is not on the face.
    """
    gain = AlbedoGain(settings.exposure, photo, conditions)
    try:
        problem = Problem(observation(photo, head, conditions), settings, gain, run)
    except ValueError as error:
        raise FaceError(f"{photo.name}: {error}; use a photo with a clearer view") from None
    gain.patch(problem.inside)

    def show(stage: str, estimate: Estimate, shading: Shading | None) -> None:
        if preview is not None:
            preview(stage, Solution(problem, estimate, shading))
            run.lap("preview")

    def after(stage: str, estimate: Estimate, shading: Shading) -> None:
        run.lap(stage)
        if keeper is not None:
            keeper.keep(stage, problem, estimate, shading, run)
        if stage != LAST_STAGE:
            show(stage, estimate, shading)

    first = (keeper.begin(problem, run) if keeper else None) or Begin(0, start(problem))
    run.losses.update(first.losses)
    show("fit", first.estimate, None)
    # Two pools of threads that both spin while waiting cost 2 to 7 times the time: the cores
    # belong to Dr.Jit.
    with threadpool_limits(1, user_api="blas"):
        estimate, shading = run_stages(problem, after, first)
    return Solution(problem, estimate, shading)
