"""What a run prints: settings, stages, progress with time left; all of it is kept as the log.

On a terminal a bar is redrawn in place; elsewhere plain lines are written, a few a stage. All of
it goes to standard error, so that standard output carries results only.
"""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

#: What one iteration of each stage costs, and what comes before, between and after, relative to
#: an iteration of stage 2: only for the time left, which is scaled to what has been measured.
_ITERATION_COST = {"stage1": 0.5, "stage2": 1.0, "stage3": 3.0, "stage4": 0.8, "stage5": 0.8}
_FIXED_COST = {"photo": 5, "perception": 40, "fit": 150, "finish": 600}
_STAGE_START_COST = 200

_LABELS = {
    "photo": "reading the photo",
    "perception": "finding the face",
    "fit": "fitting the head",
    "stage1": "stage 1: base colour and light",
    "stage2": "stage 2: low-frequency albedo",
    "stage3": "stage 3: shape",
    "stage4": "stage 4: normals",
    "stage5": "stage 5: high-frequency albedo",
    "finish": "writing results",
}
_PLAIN_SECONDS = 10.0


def standard_error() -> Console:
    """Where progress is printed: plain text, wrapped by the terminal only."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def clock(seconds: float) -> str:
    """Seconds as minutes:seconds, from an hour on as hours:minutes:seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def settings_block(settings: dict[str, Any]) -> list[str]:
    """Readable lines of nested settings: the stages side by side, then single values."""
    stages = {name: value for name, value in settings.items() if name.startswith("stage")}
    singles: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict) and name not in stages:
            singles |= {f"{name}.{field}": part for field, part in value.items()}
        elif name not in stages:
            singles[name] = value
    lines = ["settings"]
    if stages:
        lines.append(f"  {'':<22}" + "".join(f"{name:>9}" for name in stages))
        for field in next(iter(stages.values())):
            row = "".join(f"{stage.get(field, ''):>9}" for stage in stages.values())
            lines.append(f"  {field:<22}{row}")
    return [*lines, *(f"  {name:<36}{value!s:>9}" for name, value in singles.items())]


class RunConsole:
    """Prints a run's progress; call it with (stage, iteration, iterations, loss).

    iterations: of each stage, for the time left; use it as a context manager.
    """

    def __init__(self, iterations: dict[str, int], console: Console | None = None) -> None:
        self.console = console or standard_error()
        self._plan = {
            "photo": (_FIXED_COST["photo"], 0.0),
            "perception": (_FIXED_COST["perception"], 0.0),
            "fit": (_FIXED_COST["fit"], 0.0),
            **{
                name: (_STAGE_START_COST, _ITERATION_COST.get(name, 1.0) * count)
                for name, count in iterations.items()
            },
            "finish": (_FIXED_COST["finish"], 0.0),
        }
        self._lines: list[str] = []
        self._start = self._said = time.monotonic()
        self._stage = ""
        self._last = ""
        self._bar: Progress | None = None
        self._task = TaskID(0)

    def __enter__(self) -> RunConsole:
        if self.console.is_terminal:
            bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(bar_width=24),
                TextColumn("{task.fields[state]}"),
                console=self.console,
                transient=True,
            )
            self._task = bar.add_task("", total=1.0, state="")
            bar.start()
            self._bar = bar
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def say(self, line: str) -> None:
        """Print a line and keep it in the log."""
        self._lines.append(line)
        self.console.print(line, markup=False)

    def note(self, line: str) -> None:
        """Keep a line in the log without printing it."""
        self._lines.append(line)

    def log(self) -> str:
        """Everything said and noted so far."""
        return "\n".join([*self._lines, ""])

    def __call__(self, stage: str, iteration: int, iterations: int, loss: float) -> None:
        now = time.monotonic()
        begins = stage != self._stage
        if begins:
            self._end_stage(now)
            self._stage = stage
        label = _LABELS.get(stage, stage)
        counted = iterations > 1
        numbers = f"{iteration}/{iterations}  loss {loss:.4f}" if counted else ""
        self._last = numbers
        share = self._share(stage, iteration / max(iterations, 1))
        # At the very start nothing has been measured that the time left could be scaled to.
        known = share > 0.02 and now - self._start > 1
        left = f"{clock((now - self._start) * (1 - share) / share)} left" if known else ""
        if self._bar is not None:
            state = "  ".join(part for part in (numbers, left) if part)
            self._bar.update(self._task, description=label, completed=share, state=state)
        elif begins or now - self._said >= _PLAIN_SECONDS:
            parts = (clock(now - self._start), label, numbers, left)
            self.console.print("  ".join(part for part in parts if part), markup=False)
            self._said = now

    def _end_stage(self, now: float) -> None:
        if self._stage.startswith("stage"):
            line = f"{clock(now - self._start)}  {_LABELS.get(self._stage, self._stage)}"
            self.say(f"{line}  {self._last}")

    def _share(self, stage: str, part: float) -> float:
        """Estimated share of the whole run that is done."""
        total = sum(fixed + counted for fixed, counted in self._plan.values())
        done = 0.0
        for name, (fixed, counted) in self._plan.items():
            if name == stage:
                return (done + (fixed + counted * part if part else 0.0)) / total
            done += fixed + counted
        return 0.0


class FetchConsole:
    """Prints the progress of a download; call it with (asset, bytes so far, bytes in all)."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or standard_error()
        self._shown = ""

    def __call__(self, asset: Any, done: int, total: int) -> None:
        if self.console.is_terminal:
            end = "\n" if done == total else "\r"
            self.console.print(
                f"fetching {asset.name}: {done / 1e6:.1f} of {total / 1e6:.1f} MB", end=end
            )
        elif asset.name != self._shown:
            self._shown = asset.name
            kept = f", {asset.size / 1e6:.0f} MB of it kept" if total > 1.1 * asset.size else ""
            self.console.print(f"fetching {asset.name} ({total / 1e6:.0f} MB{kept})")
        sys.stderr.flush()


class StepConsole:
    """Prints the progress of a few steps; call it with (what is done now, steps done, of all)."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or standard_error()
        self._said = time.monotonic()

    def __call__(self, what: str, done: int, total: int) -> None:
        if self.console.is_terminal:
            bar = ("=" * (24 * done // total)).ljust(24)
            end = "\n" if done == total else "\r"
            self.console.print(f"[{bar}] {what:<40}", end=end, markup=False)
        elif done == 0 or time.monotonic() - self._said >= _PLAIN_SECONDS:
            self.console.print(f"{what}  {done}/{total}" if done else what, markup=False)
            self._said = time.monotonic()
        sys.stderr.flush()
