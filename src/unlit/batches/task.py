"""The work on one photo, as a worker does it: any number of times with the same outcome.

Dask runs a task again when its worker was lost, even if it had ended. So a task first looks
whether its photo is done. It is light to import: the scheduler imports it, too.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UnlitError
from ..storage.folder import REPORT, THUMBNAIL
from .folder import RECORDS, BatchFolder
from .record import BatchRow, Record, common_identity, with_photo
from .working import Teller

if TYPE_CHECKING:
    from ..face.reconstruction import Reconstruction
    from ..head.model import HeadModel
    from ..output.save import Page
    from ..perception.landmarks import DetectedFace
    from ..photo.photo import Photo
    from ..progress.log import Log
    from ..settings.settings import Settings
    from ..storage.identity import Identity

#: Dr.Jit has one pool of threads and one queue of kernels per process: one photo at a time.
_ONE_PHOTO = threading.Lock()


@dataclass(frozen=True)
class PhotoTask:
    """One photo to be done.

    photo: its path. name: of its result. store: the batch's folder or URL. settings: nested plain
    values. face: as for `pipeline.chain.reconstruct`, or "all". reports: whether each result gets
    its report.html.
    """

    photo: str
    name: str
    store: str
    settings: dict[str, Any]
    face: str | int
    reports: bool = True


class Stopped(Exception):
    """The batch was interrupted, and nobody waits for this photo any more."""


def finished_rows(
    record: Record | None, identity: Identity | None, store: BatchFolder
) -> list[BatchRow] | None:
    """The rows in `record` if all are results made from `identity` and still there, else None.

    A report may have been written later, by `unlit report`: it is looked for.
    """
    if record is None:
        return None
    done = record.results(identity)
    whole = len(done) == len(record.rows) and all(store.is_whole(place) for place in done)
    if not whole:
        return None
    return [
        row if row.report else replace(row, report=store.holds(f"{row.folder}/{REPORT}"))
        for row in record.rows
    ]


def run(job: PhotoTask) -> list[BatchRow]:
    """Do `job` unless it is done: one row per face.

    What is wrong with the photo, or goes wrong with it, becomes a row with the error. Raises
    OutputError only where not even that can be written.
    """
    with _ONE_PHOTO:
        _take_share_of_cores()
        store = BatchFolder(job.store)
        record = store.record(job.name)
        identity = None
        try:
            settings, head = _settings_and_head(job)
        except Exception as error:
            rows = [failure(job, error)]
        else:
            identity = with_photo(common_identity(settings, head, job.face), Path(job.photo))
            known = finished_rows(record, identity, store)
            if known is not None:
                return known
            rows = _rows(job, settings, head, store, record.results(identity) if record else {})
        store.write(f"{RECORDS}/{job.name}.json", Record(job.photo, identity, rows).encode())
        return rows


def _settings_and_head(job: PhotoTask) -> tuple[Settings, HeadModel]:
    from ..head.sources.library import head_model
    from ..settings.settings import PRESETS, override

    settings = override(PRESETS["paper"], job.settings)
    return settings, head_model(settings.head_model)


def _rows(
    job: PhotoTask,
    settings: Settings,
    head: HeadModel,
    store: BatchFolder,
    done: dict[str, BatchRow],
) -> list[BatchRow]:
    """One row per face; what is in `done`, by folder, is taken from there."""
    from ..output.save import needed_bytes
    from ..photo.photo import read_photo

    try:
        photo = read_photo(job.photo)
        faces = _faces(photo, job)
    except Exception as error:
        return [failure(job, error)]
    rows = []
    for place, face in faces.items():
        if place in done and store.is_whole(place):
            rows.append(done[place])
            continue
        try:
            with store.result(place, needed_bytes(settings.resolution)) as folder:
                tell = _teller(job.name, place, settings)
                row = _result(photo, settings, head, face, folder, tell, job.reports)
            rows.append(replace(row, photo=job.photo, folder=place))
        except Stopped:
            raise
        except Exception as error:
            rows.append(failure(job, error))
        finally:
            _free_memory()
    return rows


def failure(job: PhotoTask, error: Exception) -> BatchRow:
    """A row about what went wrong; what is no user's doing is named so that it can be reported."""
    if isinstance(error, UnlitError):
        text = str(error)
    elif isinstance(error, MemoryError) or "out of memory" in str(error):
        text = f"{job.photo}: not enough memory; use fewer workers or a lower resolution"
    else:
        text = f"{job.photo}: {type(error).__name__}: {error}; try `unlit reconstruct` on it"
    return BatchRow(job.photo, error=" ".join(text.split()))


def _faces(photo: Photo, job: PhotoTask) -> dict[str, str | int | DetectedFace]:
    """Where the result of each face goes, and which face it is."""
    if job.face != "all":
        return {job.name: job.face}
    from ..perception.landmarks import choose, find_faces

    found = find_faces(photo.encoded8())
    choose(found, "largest", photo.source)  # raises where there is none
    return {f"{job.name}/face{k}": face for k, face in enumerate(found)}


def _result(
    photo: Photo,
    settings: Settings,
    head: HeadModel,
    face: str | int | DetectedFace,
    folder: Path,
    tell: Teller,
    reports: bool,
) -> BatchRow:
    """Reconstruct one face of `photo` and save it to `folder`; a row without names."""
    from ..evaluate.metrics import psnr
    from ..output.save import save
    from ..pipeline.chain import reconstruct

    log, stop_if_cancelled = _log(photo, settings), _stop_if_cancelled()

    def progress(stage: str, iteration: int, iterations: int, loss: float) -> None:
        stop_if_cancelled()
        tell(stage, iteration, iterations)
        log(stage, iteration, iterations, loss)

    result = reconstruct(photo, settings=settings, face=face, model=head, progress=progress)
    start = time.perf_counter()
    save(result, folder, log.text(), _pages(result, reports))
    metrics, inside = result.metrics, result.face.mask > 0.5
    shown = result.images.render, result.photo.image
    return BatchRow(
        photo="",
        warnings=list(metrics.warnings),
        seconds={**metrics.seconds, "writing": time.perf_counter() - start},
        landmark_residual=result.head.landmark_residual,
        render_psnr=psnr(*shown, inside) if inside.any() else None,
        losses={stage: pairs[-1][1] for stage, pairs in metrics.losses.items() if pairs},
        report=(folder / REPORT).is_file(),
        thumbnail=(folder / THUMBNAIL).is_file(),
    )


def _pages(result: Reconstruction, reports: bool) -> dict[str, Page]:
    from ..output.thumbnail import thumbnail_webp
    from ..report.page import report_html

    pages: dict[str, Page] = {THUMBNAIL: lambda _, pictures: thumbnail_webp(result, pictures)}
    if reports:
        pages[REPORT] = lambda atlas, pictures: report_html(
            result, atlas, pictures=pictures
        ).encode()
    return pages


def _teller(job: str, place: str, settings: Settings) -> Teller:
    from ..machine import cost

    worker = _worker()
    cores = cost.cores() if worker is None else worker.state.nthreads
    plan = cost.plan(settings.resolution, settings.iterations(0), cores, settings.solver)
    return Teller(worker, job, place, plan)


def _log(photo: Photo, settings: Settings) -> Log:
    """What `unlit reconstruct` would print, kept for the result's log only."""
    from ..progress.log import Log, settings_lines
    from ..settings.settings import as_dict

    log = Log()
    height, width = photo.pixels.shape[:2]
    log.note(f"photo     {photo.source}, {width} x {height}, {photo.colours}")
    log.note(*settings_lines(as_dict(settings)))
    return log


def _take_share_of_cores() -> None:
    """Let Dr.Jit use as many threads as this process's worker has; all cores without a worker.

    Two pools of threads on the same cores would slow each other down by far more than half.
    """
    worker = _worker()
    if worker is not None:
        from ..machine.runtime import mitsuba

        mitsuba()
        import drjit as dr

        dr.set_thread_count(worker.state.nthreads)


def _stop_if_cancelled() -> Callable[[], None]:
    """A function that raises Stopped once the batch has cancelled the task of this thread."""
    worker = _worker()
    if worker is None:
        return lambda: None
    key = worker.get_current_task()

    def check() -> None:
        task = worker.state.tasks.get(key)
        if task is None or task.state == "cancelled":
            raise Stopped

    return check


def _worker() -> Any:
    """The Dask worker that runs this thread, or None."""
    from distributed import get_worker

    try:
        return get_worker()
    except ValueError:
        return None


def _free_memory() -> None:
    """Give back what the last photo took, for a worker may see thousands."""
    import drjit as dr

    gc.collect()
    dr.flush_malloc_cache()


async def idle(seconds: float) -> None:
    """Wait, in a worker's event loop, until it works on no photo, but not longer than `seconds`."""
    import asyncio

    end = time.monotonic() + seconds
    while _ONE_PHOTO.locked() and time.monotonic() < end:
        await asyncio.sleep(0.1)
