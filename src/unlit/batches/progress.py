"""What a batch prints on standard error: a bar with counts and the time left, and what failed."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from ..progress.console import clock, standard_error
from .record import Row, readable
from .run import Counts

_PLAIN_SECONDS = 60.0


class BatchConsole:
    """Shows `Counts`; give it to `run_batch` and use it as a context manager.

    On a terminal a bar is redrawn in place; elsewhere a line is printed for each photo.
    """

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or standard_error()
        self._bar = Progress(
            BarColumn(bar_width=24),
            TextColumn("{task.description}", markup=False),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task("")
        self._began: float | None = None
        self._said: float | None = None
        self._counts: Counts | None = None

    def __enter__(self) -> BatchConsole:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bar.stop()
        if error is None and self._counts is not None:
            self._say(", ".join(_finished(self._counts)))

    def __call__(self, counts: Counts, rows: list[Row]) -> None:
        now, self._counts = time.monotonic(), counts
        if counts.workers and self._began is None:
            self._began = now
        state = self._state(counts, now)
        self._bar.update(
            self._task, total=counts.photos, completed=counts.finished, description=state
        )
        for row in rows:
            if row.error:
                self._say(f"failed  {row.error}")
            elif not self.console.is_terminal:
                self._say(f"done  {row.folder}  {sum(row.seconds.values()):.0f} s  ({state})")
        if rows:
            self._said = now
        elif counts.running and (self._said is None or now - self._said > _PLAIN_SECONDS):
            self._said = now
            if not self.console.is_terminal:
                self._say(state)

    def _say(self, line: str) -> None:
        self.console.print(readable(line), markup=False)

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


def _finished(counts: Counts) -> list[str]:
    parts = [f"{counts.finished} of {counts.photos}"]
    if counts.before:
        parts.append(f"{counts.before} done before")
    if counts.failed:
        parts.append(f"{counts.failed} failed")
    return parts
