"""What a batch prints on standard error: a bar with counts and the time left, and what failed."""

from __future__ import annotations

import time

from rich.console import Console

from ..batches.record import BatchRow
from ..batches.run import Counts
from ..batches.working import PhotoProgress
from ..progress.console import Display
from ..progress.log import LABELS, clock
from ..storage.names import readable


class BatchConsole(Display):
    """Shows `Counts`; give it to `run_batch` and use it as a context manager.

    On a terminal a bar is redrawn in place, with one below it for each worker; elsewhere a line
    is printed for each photo.
    """

    def __init__(self, console: Console | None = None) -> None:
        super().__init__(console, every=60.0)
        self._began: float | None = None
        self._counts: Counts | None = None

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        super().__exit__(kind)
        if kind is None and self._counts is not None:
            self.say(", ".join(_finished(self._counts)))

    def __call__(self, counts: Counts, rows: list[BatchRow]) -> None:
        now, self._counts = time.monotonic(), counts
        if counts.workers and self._began is None:
            self._began = now
            if counts.dashboard:
                self.say(f"dashboard  {counts.dashboard}")
            for what, photos in counts.anew.items():
                plural = "" if photos == 1 else "s"
                self.say(readable(f"anew  {photos} photo{plural}: the earlier result is of {what}"))
        state = self._state(counts, now)
        for row in rows:
            if row.error:
                self.say(readable(f"failed  {row.error}"))
            elif not self.redraws:
                self.say(
                    readable(f"done  {row.folder}  {sum(row.seconds.values()):.0f} s  ({state})")
                )
        self.show_parts([(working.share, _part(working)) for working in counts.working])
        if self.redraws or (counts.running and not rows):
            self.show(counts.finished / max(counts.photos, 1), state)

    def _state(self, counts: Counts, now: float) -> str:
        parts = _finished(counts)
        if self._began is not None:
            parts.append(f"{counts.workers} worker{'' if counts.workers == 1 else 's'}")
            if counts.running:
                parts.append(f"{counts.running} running for up to {clock(counts.longest)}")
            if counts.done:  # what fails mostly does so at once, and tells nothing of the rest
                seconds = (now - self._began) / counts.done * (counts.photos - counts.finished)
                parts.append(f"{clock(seconds)} left")
        return ", ".join(parts)


def _part(working: PhotoProgress) -> str:
    """What one worker does: the result, the step, the time left."""
    left = [] if working.left is None else [f"{clock(working.left)} left"]
    return readable("  ".join([working.place, LABELS.get(working.step, working.step), *left]))


def _finished(counts: Counts) -> list[str]:
    parts = [f"{counts.finished} of {counts.photos}"]
    if counts.before:
        parts.append(f"{counts.before} done before")
    if counts.failed:
        parts.append(f"{counts.failed} failed")
    return parts
