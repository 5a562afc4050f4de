"""The log of a reconstruction: its settings, the end of each stage, numbers and warnings."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

#: What is being done, by step.
LABELS = {
    "photo": "reading the photo",
    "perception": "finding the face",
    "fit": "fitting the head",
    "conditions": "looking for shadows and the light's colour",
    "stage1": "stage 1: base colour and light",
    "stage2": "stage 2: low-frequency albedo",
    "stage3": "stage 3: shape",
    "stage4": "stage 4: normals",
    "stage5": "stage 5: high-frequency albedo",
    "finish": "writing results",
}


def clock(seconds: float) -> str:
    """Seconds as minutes:seconds, from an hour on as hours:minutes:seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def settings_lines(settings: Mapping[str, Any]) -> list[str]:
    """Readable lines of nested settings: the stages side by side, then one value a line."""
    tables: dict[str, dict[str, Any]] = {
        name: value for name, value in settings.items() if isinstance(value, dict)
    }
    stages = {name: table for name, table in tables.items() if name.startswith("stage")}
    lines = ["settings"]
    if stages:
        lines.append(f"  {'':<22}" + "".join(f"{name:>9}" for name in stages))
        for field in dict.fromkeys(field for stage in stages.values() for field in stage):
            row = "".join(f"{stage.get(field, ''):>9}" for stage in stages.values())
            lines.append(f"  {field:<22}{row}")
    for name, value in settings.items():
        if name not in tables:
            lines.append(f"  {name:<22}{value!s:>9}")
    for name, table in tables.items():
        if name not in stages:
            lines += [f"  {f'{name}.{inner}':<22}{value!s:>9}" for inner, value in table.items()]
    return lines


def progress_text(iteration: int, iterations: int, loss: float) -> str:
    """How far a stage is; empty for a step that does not iterate."""
    return f"{iteration}/{iterations}  loss {loss:.4f}" if iterations > 1 else ""


class Log:
    """Lines kept in the order they were said; call it with (step, iteration, iterations, loss).

    show: called with every line that is said, as to print it.
    """

    def __init__(self, show: Callable[[str], None] = lambda line: None) -> None:
        self._show = show
        self._lines: list[str] = []
        self._start = time.monotonic()
        self._step = self._last = ""

    @property
    def seconds(self) -> float:
        """Since the log was begun."""
        return time.monotonic() - self._start

    def say(self, line: str) -> None:
        """Keep a line and show it."""
        self._lines.append(line)
        self._show(line)

    def note(self, *lines: str) -> None:
        """Keep lines without showing them."""
        self._lines += lines

    def text(self) -> str:
        """Everything said and noted so far."""
        return "\n".join([*self._lines, ""])

    def __call__(self, step: str, iteration: int, iterations: int, loss: float) -> None:
        if step != self._step:
            if self._step.startswith("stage"):
                label = LABELS.get(self._step, self._step)
                self.say(f"{clock(self.seconds)}  {label}  {self._last}")
            self._step = step
        self._last = progress_text(iteration, iterations, loss)
