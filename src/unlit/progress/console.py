"""The progress of a run, of a download and of a few steps, as callbacks that print it.

One line tells how far something is: a bar where it can be redrawn, else now and then. All of it
goes to standard error, so that standard output carries results only.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
from rich.text import Text

from .log import LABELS, Log, clock, progress_text
from .time_left import TimeLeft


def standard_error() -> Console:
    """Where progress is printed: plain text, wrapped by the terminal only."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def _redraws(console: Console) -> bool:
    """Terminals do; notebooks where ipywidgets are installed."""
    if console.is_jupyter:
        return importlib.util.find_spec("ipywidgets") is not None
    return console.is_terminal


class _Clock(ProgressColumn):
    """Time since a bar was begun. It moves also while a step has nothing new to tell."""

    def render(self, task: Task) -> Text:
        first = task.id == 0  # those below it (show_parts) are of others' work
        return Text(clock(task.elapsed or 0) if first else "")


class Display:
    """A bar with a text beside it, or where none can be drawn plain lines.

    every: seconds between two plain lines. Use it as a context manager: at its end the bar goes.
    """

    def __init__(self, console: Console | None = None, every: float = 10.0) -> None:
        self.console = console or standard_error()
        self.redraws = _redraws(self.console)
        self._every = every
        self._said = -math.inf
        self._bar = Progress(
            BarColumn(bar_width=24),
            _Clock(),
            TextColumn("{task.description}", markup=False),
            console=self.console,
            transient=True,
            disable=not self.redraws,
        )
        self._task = self._bar.add_task("", total=1.0)
        self._parts: list[TaskID] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.stop()

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self.console.print(line, markup=False)

    def show_parts(self, parts: Sequence[tuple[float, str]]) -> None:
        """Below the bar, one for each of what is done at the same time: share and text.

        Only where bars can be redrawn; of lines there would be too many.
        """
        if not self.redraws:
            return
        while len(self._parts) < len(parts):
            self._parts.append(self._bar.add_task("", total=1.0))
        for number, task in enumerate(self._parts):
            share, text = parts[number] if number < len(parts) else (0.0, "")
            self._bar.update(task, completed=share, description=text, visible=number < len(parts))

    def show(self, share: float, text: str, line: str = "", now: bool = False) -> None:
        """`share`, 0 to 1, is done of what `text` names.

        line: the plain line, if it is not `text`. now: whether it is due whatever the time.
        """
        if self.redraws:
            self._bar.start()
            self._bar.update(self._task, completed=share, description=text)
        elif now or time.monotonic() - self._said >= self._every:
            self.say(line or text)
            self._said = time.monotonic()


class RunConsole(Display):
    """A run's progress; call it with (step, iteration, iterations, loss).

    plan: seconds that each step is expected to take, in order (`machine.cost.plan`), for the time
    left; what has been measured scales them. log: what is said, and the end of each stage.
    """

    def __init__(self, plan: Mapping[str, float], console: Console | None = None) -> None:
        super().__init__(console)
        self.log = Log(self.say)
        self._time_left = TimeLeft(plan)
        self._step = ""

    def __call__(self, step: str, iteration: int, iterations: int, loss: float) -> None:
        self.log(step, iteration, iterations, loss)
        begins, self._step = step != self._step, step
        label, seconds = LABELS.get(step, step), self.log.seconds
        part = iteration / max(iterations, 1)
        share, rest = (
            self._time_left.share(step, part),
            self._time_left.seconds(step, part, seconds),
        )
        left = "" if rest is None else f"{clock(rest)} left"
        parts = [part for part in (label, progress_text(iteration, iterations, loss), left) if part]
        self.show(share, "  ".join(parts), "  ".join((clock(seconds), *parts)), begins)


class FetchConsole(Display):
    """The progress of downloads; call it with (file, bytes so far, bytes in all).

    file: by its `name` and its `size`, bytes.
    """

    _name = ""

    def __call__(self, file: Any, done: int, total: int) -> None:
        begins, self._name = file.name != self._name, file.name
        text = f"fetching {file.name}: {done / 1e6:.1f} of {total / 1e6:.1f} MB"
        kept = f", {file.size / 1e6:.0f} MB of it kept" if total > 1.1 * file.size else ""
        line = f"fetching {file.name} ({total / 1e6:.0f} MB{kept})" if begins else text
        self.show(done / total, text, line, begins)


class StepConsole(Display):
    """The progress of a few steps; call it with (what is done now, steps done, of all)."""

    def __call__(self, what: str, done: int, total: int) -> None:
        self.show(done / total, what, f"{what}  {done}/{total}" if done else what, done == 0)


class StudyConsole:
    """The progress of an evaluation: a line for each step, and a bar while a face is made.

    plan: as for RunConsole.
    """

    def __init__(self, plan: Mapping[str, float], console: Console | None = None) -> None:
        self._console = console or standard_error()
        self._plan = plan
        self._log = Log(lambda line: self._console.print(line, markup=False))

    def _begin(self, name: str) -> None:
        self._log.say(f"{clock(self._log.seconds)}  {name}")

    def busy(self, name: str) -> AbstractContextManager[object]:
        """While a step without a progress of its own is done."""
        self._begin(name)
        return self._console.status(name) if self._console.is_terminal else nullcontext()

    def running(self, name: str) -> RunConsole:
        """While a face is reconstructed."""
        self._begin(name)
        return RunConsole(self._plan, self._console)
