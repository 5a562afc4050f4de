"""A batch from end to end: what is left to do, the work on it, the summary."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import distributed
from distributed import CancelledError, Client, Future, KilledWorker

from ..errors import MachineError, UnlitError
from ..settings.settings import Settings, as_dict
from . import task
from .cluster import connected
from .photos import name_results
from .record import Row
from .store import RECORDS, TABLES, Store
from .table import write_tables
from .task import Job

#: How often the number of workers is looked at, and how long Ctrl-C waits for files being written.
_POLL_SECONDS = 2.0
_GRACE_SECONDS = 20.0
#: The summary is written anew after this long.
_TABLE_SECONDS = 60.0


@dataclass
class Counts:
    """How far a batch is: photos in all, done before it began, done, failed; workers;
    photos being worked on, and the seconds that the first of them has taken so far.
    """

    photos: int
    before: int = 0
    done: int = 0
    failed: int = 0
    workers: int = 0
    running: int = 0
    longest: float = 0.0

    @property
    def finished(self) -> int:
        """Photos that nothing more is done about."""
        return self.before + self.done + self.failed


#: What is worked on, and since when (monotonic clock).
Running = dict[Future, tuple[Job, float]]


class Watch(Protocol):
    """Told of every photo that is finished, with its rows, and otherwise now and then."""

    def __call__(self, counts: Counts, rows: list[Row]) -> None: ...


def run_batch(
    photos: Sequence[Path],
    folder: str,
    settings: Settings,
    face: str | int,
    scheduler: str | None,
    watch: Watch,
    memory: float | None = None,
) -> list[Row]:
    """Reconstruct every photo into `folder` (a path or URL) that is not done, and sum it up.

    photos: absolute paths, which the workers see, too. face: as for `pipeline.reconstruct`, or
    "all". memory: bytes that workers on this machine may take together. Returns the rows of all
    photos in order. An interruption ends the work on the photos at hand; what is done stays, and
    the next call goes on. Raises OutputError and MachineError.
    """
    store = Store(folder)
    records = store.records()
    owners = {name: record.photo for name, record in records.items()}
    names = name_results(photos, owners, (RECORDS, *TABLES))
    counts = Counts(len(photos))
    rows: dict[str, list[Row]] = {}
    left: deque[Job] = deque()
    for photo, name in names.items():
        job = Job(str(photo), name, store.url, as_dict(settings), face)
        known = task.known_rows(job, store, records.get(name))
        if known is None:
            left.append(job)
        else:
            rows[name], counts.before = known, counts.before + 1
        watch(counts, [])

    def summed_up() -> list[Row]:
        return [row for name in names.values() for row in rows.get(name, [])]

    write_tables(store, summed_up())  # tells now, not after hours, if nothing can be written there
    if not left:
        return summed_up()
    written = time.monotonic()
    running: Running = {}

    def keep(job: Job, new: list[Row]) -> None:
        nonlocal written
        rows[job.name] = new
        if any(row.error for row in new):
            counts.failed += 1
        else:
            counts.done += 1
        watch(counts, new)
        if time.monotonic() - written > _TABLE_SECONDS:
            write_tables(store, summed_up())
            written = time.monotonic()

    try:
        with connected(scheduler, len(left), settings.resolution, memory) as client:
            _work(client, left, running, counts, watch, keep)
    finally:
        rows |= _unseen(running, store)
        write_tables(store, summed_up())
    return summed_up()


def _unseen(running: Running, store: Store) -> dict[str, list[Row]]:
    """Rows of the photos in `running` that were done nevertheless when it was interrupted."""
    jobs = [job for job, _ in running.values()]
    found = {job.name: task.known_rows(job, store, store.record(job.name)) for job in jobs}
    return {name: rows for name, rows in found.items() if rows is not None}


def _work(
    client: Client,
    left: deque[Job],
    running: Running,
    counts: Counts,
    watch: Watch,
    keep: Callable[[Job, list[Row]], None],
) -> None:
    """Do the jobs in `left`, as many at a time as there are workers; `keep` gets each one's rows.

    One a worker, so that none waits behind another while somebody is idle, and workers that come
    later find work. After an interruption `running` holds what was not ended.
    """
    try:
        while left or running:
            counts.workers = len(client.nthreads())  # type: ignore[arg-type]
            while left and len(running) < counts.workers:
                job = left.popleft()
                running[client.submit(task.run, job, pure=False)] = job, time.monotonic()
            counts.running = len(running)
            begun = min((start for _, start in running.values()), default=time.monotonic())
            counts.longest = time.monotonic() - begun
            watch(counts, [])
            for future in _first_finished(running):
                rows = _rows(future, running[future][0])
                counts.running -= 1
                keep(running.pop(future)[0], rows)
    except (OSError, CancelledError) as error:
        raise MachineError(
            "the Dask scheduler was lost; what is done is kept, run the same again"
        ) from error
    finally:
        if running:
            with contextlib.suppress(Exception):
                client.cancel(list(running), force=True)
                client.run(task.idle, _GRACE_SECONDS)


def _first_finished(running: Running) -> list[Future]:
    """The futures that have ended, after waiting a while for the first."""
    if not running:
        time.sleep(_POLL_SECONDS)  # for a worker to come
        return []
    try:
        distributed.wait(list(running), timeout=_POLL_SECONDS, return_when="FIRST_COMPLETED")
    except TimeoutError:
        return []
    return [future for future in running if future.done()]


def _rows(future: Future, job: Job) -> list[Row]:
    """What the task returned, or a row about why it did not. Raises CancelledError."""
    try:
        return future.result()
    except KilledWorker as error:
        text = (
            f"{job.photo}: {error.allowed_failures + 1} worker processes died of it, perhaps for "
            "want of memory; use a lower resolution"
        )
        return [Row(job.photo, error=text)]
    except UnlitError as error:
        return [task.failure(job, error)]
