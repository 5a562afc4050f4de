"""A batch from end to end: what is left to do, the work on it, the summary."""

from __future__ import annotations

import contextlib
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import distributed
from distributed import CancelledError, Client, Future, KilledWorker

from ..errors import MachineError, UnlitError
from ..settings.settings import Settings, as_dict
from ..storage.identity import Identity
from . import task
from .cluster import connected
from .folder import RECORDS, TABLES, BatchFolder
from .photos import name_results
from .record import BatchRow, Record, common_identity, with_photo
from .table import write_tables
from .task import PhotoTask
from .working import PhotoProgress, listening

#: How often the number of workers is looked at, and how long Ctrl-C waits for files being written.
_POLL_SECONDS = 2.0
_GRACE_SECONDS = 20.0
#: The summary is written anew after this long.
_TABLE_SECONDS = 60.0


@dataclass
class Counts:
    """How far a batch is: photos in all, done before it began, done, failed; workers;
    photos being worked on, and the seconds that the first of them has taken so far; how far they
    are, as far as their workers told; address of Dask's dashboard; photos that are done again, by
    what their results were made from.
    """

    photos: int
    before: int = 0
    done: int = 0
    failed: int = 0
    workers: int = 0
    running: int = 0
    longest: float = 0.0
    working: list[PhotoProgress] = field(default_factory=list)
    dashboard: str = ""
    anew: Counter[str] = field(default_factory=Counter)

    @property
    def finished(self) -> int:
        """Photos that nothing more is done about."""
        return self.before + self.done + self.failed


#: What is worked on, and since when (monotonic clock).
RunningTasks = dict[Future, tuple[PhotoTask, float]]
#: Told of every photo that is finished, with its rows, and otherwise now and then.
BatchWatch = Callable[[Counts, list[BatchRow]], None]


@dataclass(frozen=True)
class BatchRequest:
    """What is asked of a batch.

    photos: absolute paths, which the workers see, too. folder: a path or URL. face: as for
    `chain.reconstruct`, or "all". scheduler: address of a Dask cluster; None for workers on this
    machine. memory: bytes that these may take together. reports: whether each result gets its
    report.html. dashboard: whether Dask's page on its work is served.
    """

    photos: Sequence[Path]
    folder: str
    settings: Settings
    face: str | int = "only"
    scheduler: str | None = None
    memory: float | None = None
    reports: bool = True
    dashboard: bool = False


def run_batch(request: BatchRequest, watch: BatchWatch) -> list[BatchRow]:
    """Reconstruct every photo that is not done, and sum it up.

    Returns the rows of all photos in order. An interruption ends the work on the photos at hand;
    what is done stays, and the next call goes on. Raises OutputError and MachineError.
    """
    photos, settings, face = request.photos, request.settings, request.face
    store = BatchFolder(request.folder)
    records = store.records()
    owners = {name: record.photo for name, record in records.items()}
    names = name_results(photos, owners, (RECORDS, *TABLES))
    counts = Counts(len(photos))
    common = _common_identity(settings, face) if photos else None
    rows: dict[str, list[BatchRow]] = {}
    left: deque[PhotoTask] = deque()
    for photo, name in names.items():
        job = PhotoTask(str(photo), name, store.url, as_dict(settings), face, request.reports)
        known = _known_rows(job, records.get(name), common, store, counts)
        if known is None:
            left.append(job)
        else:
            rows[name], counts.before = known, counts.before + 1
        watch(counts, [])

    def summed_up() -> list[BatchRow]:
        return [row for name in names.values() for row in rows.get(name, [])]

    # Tells now, not after hours, if nothing can be written there.
    write_tables(store, summed_up(), len(left))
    if not left:
        return summed_up()
    written, running = time.monotonic(), RunningTasks()

    def keep(job: PhotoTask, new: list[BatchRow]) -> None:
        nonlocal written
        rows[job.name] = new
        if any(row.error for row in new):
            counts.failed += 1
        else:
            counts.done += 1
        watch(counts, new)
        if time.monotonic() - written > _TABLE_SECONDS:
            write_tables(store, summed_up(), counts.photos - counts.finished)
            written = time.monotonic()

    try:
        scheduler, memory, dashboard = request.scheduler, request.memory, request.dashboard
        with (
            connected(scheduler, len(left), settings.resolution, memory, dashboard) as client,
            listening(client) as told,
        ):
            counts.dashboard = str(client.dashboard_link) if dashboard else ""
            _work(client, left, running, counts, told, watch, keep)
    finally:
        rows |= _finished_meanwhile(running, common, store)
        write_tables(store, summed_up(), sum(name not in rows for name in names.values()))
    return summed_up()


def _known_rows(
    job: PhotoTask,
    record: Record | None,
    common: Identity | None,
    store: BatchFolder,
    counts: Counts,
) -> list[BatchRow] | None:
    """The rows of a photo that is done, else None; what its result was made from is counted."""
    if record is None or common is None:
        return None
    identity = with_photo(common, Path(job.photo))
    rows = task.finished_rows(record, identity, store)
    if record.identity and identity and (what := record.identity.difference(identity)):
        counts.anew[what] += 1
    return rows


def _common_identity(settings: Settings, face: str | int) -> Identity | None:
    """None where the head model cannot be read here; workers may have it, and know what is done."""
    from ..head.sources.library import head_model

    try:
        return common_identity(settings, head_model(settings.head_model), face)
    except UnlitError:
        return None


def _finished_meanwhile(
    running: RunningTasks, common: Identity | None, store: BatchFolder
) -> dict[str, list[BatchRow]]:
    """Rows of the photos in `running` that were done nevertheless when it was interrupted."""
    found = {}
    for job, _ in running.values():
        identity = common and with_photo(common, Path(job.photo))
        rows = task.finished_rows(store.record(job.name), identity, store)
        if rows is not None:
            found[job.name] = rows
    return found


def _work(
    client: Client,
    left: deque[PhotoTask],
    running: RunningTasks,
    counts: Counts,
    told: Mapping[str, PhotoProgress],
    watch: BatchWatch,
    keep: Callable[[PhotoTask, list[BatchRow]], None],
) -> None:
    """Do the jobs in `left`, as many at a time as there are workers; `keep` gets each one's rows.

    One a worker, so that none waits behind another while somebody is idle, and workers that come
    later find work. told: how far each is. After an interruption `running` holds what was not
    ended.
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
            names = [job.name for job, _ in running.values()]
            counts.working = [told[name] for name in names if name in told]
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


def _first_finished(running: RunningTasks) -> list[Future]:
    """The futures that have ended, after waiting a while for the first."""
    if not running:
        time.sleep(_POLL_SECONDS)  # for a worker to come
        return []
    try:
        distributed.wait(list(running), timeout=_POLL_SECONDS, return_when="FIRST_COMPLETED")
    except TimeoutError:
        return []
    return [future for future in running if future.done()]


def _rows(future: Future, job: PhotoTask) -> list[BatchRow]:
    """What the task returned, or a row about why it did not. Raises CancelledError."""
    try:
        return future.result()
    except KilledWorker as error:
        text = (
            f"{job.photo}: {error.allowed_failures + 1} worker processes died of it, perhaps for "
            "want of memory; use a lower resolution"
        )
        return [BatchRow(job.photo, error=text)]
    except UnlitError as error:
        return [task.failure(job, error)]
