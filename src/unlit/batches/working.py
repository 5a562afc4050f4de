"""What a worker tells of the photo that it works on: the step it is at, and the time left.

It goes as Dask's events from the worker through the scheduler to whoever leads the batch, small
and now and then; one that is lost is followed by the next.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ..progress.time_left import TimeLeft

if TYPE_CHECKING:
    from distributed import Client

_TOPIC, _PROGRESS = "unlit-working", "progress"
_EVERY_SECONDS = 2.0


@dataclass(frozen=True)
class PhotoProgress:
    """job: name of the photo's task. place: of the result. step: as `progress.log.LABELS` has it.

    share: of the run that is done, 0 to 1, estimated. left: seconds, None where not known yet.
    """

    job: str
    place: str
    step: str
    share: float
    left: float | None


class Teller:
    """Tells of one face, in the worker; call it with (step, iteration, iterations).

    worker: Dask's, None for nobody to tell. plan: as for TimeLeft.
    """

    def __init__(self, worker: Any, job: str, place: str, plan: Mapping[str, float]) -> None:
        self._worker, self._job, self._place = worker, job, place
        self._left = TimeLeft(plan)
        self._began = time.monotonic()
        self._told, self._step = 0.0, ""

    def __call__(self, step: str, iteration: int, iterations: int) -> None:
        now = time.monotonic()
        if self._worker is None or (step == self._step and now - self._told < _EVERY_SECONDS):
            return
        self._told, self._step = now, step
        part = iteration / max(iterations, 1)
        left = self._left.seconds(step, part, now - self._began)
        progress = PhotoProgress(self._job, self._place, step, self._left.share(step, part), left)
        self._worker.log_event(_TOPIC, {_PROGRESS: asdict(progress)})


@contextlib.contextmanager
def listening(client: Client) -> Iterator[dict[str, PhotoProgress]]:
    """The latest of what the workers told, by task; it changes while the block lasts."""
    latest: dict[str, PhotoProgress] = {}

    def heard(event: tuple[float, dict[str, Any]]) -> None:
        progress = PhotoProgress(**event[1][_PROGRESS])  # beside it Dask names the worker
        latest[progress.job] = progress

    client.subscribe_topic(_TOPIC, heard)
    try:
        yield latest
    finally:
        with contextlib.suppress(Exception):  # the scheduler may be gone
            client.unsubscribe_topic(_TOPIC)
