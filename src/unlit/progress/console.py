"""The progress of a run, of a download and of a few steps, as callbacks that print it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from rich.console import Console

from .display import Display, standard_error
from .log import LABELS, Log, clock, progress_text


class RunConsole(Display):
    """A run's progress; call it with (step, iteration, iterations, loss).

    plan: seconds that each step is expected to take, in order (`machine.cost.plan`), for the time
    left; what has been measured scales them. log: what is said, and the end of each stage.
    """

    def __init__(self, plan: Mapping[str, float], console: Console | None = None) -> None:
        super().__init__(console)
        self.log = Log(self.say)
        self._plan = plan
        self._step = ""

    def __call__(self, step: str, iteration: int, iterations: int, loss: float) -> None:
        self.log(step, iteration, iterations, loss)
        begins, self._step = step != self._step, step
        label, seconds = LABELS.get(step, step), self.log.seconds
        share = self._share(step, iteration / max(iterations, 1))
        # At the very start nothing has been measured that the time left could be scaled to.
        known = share > 0.02 and seconds > 1
        left = f"{clock(seconds * (1 - share) / share)} left" if known else ""
        parts = [part for part in (label, progress_text(iteration, iterations, loss), left) if part]
        self.show(share, "  ".join(parts), "  ".join((clock(seconds), *parts)), begins)

    def _share(self, step: str, part: float) -> float:
        """Estimated share of the whole run that is done."""
        names = list(self._plan)
        if step not in names:
            return 0.0
        before = sum(self._plan[name] for name in names[: names.index(step)])
        return (before + self._plan[step] * part) / sum(self._plan.values())


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
