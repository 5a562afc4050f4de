"""One line that tells how far something is: a bar where it can be redrawn, else now and then.

All of it goes to standard error, so that standard output carries results only.
"""

from __future__ import annotations

import importlib.util
import math
import time
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn


def standard_error() -> Console:
    """Where progress is printed: plain text, wrapped by the terminal only."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def _redraws(console: Console) -> bool:
    """Terminals do; notebooks where ipywidgets are installed."""
    if console.is_jupyter:
        return importlib.util.find_spec("ipywidgets") is not None
    return console.is_terminal


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
            TextColumn("{task.description}", markup=False),
            console=self.console,
            transient=True,
            disable=not self.redraws,
        )
        self._task = self._bar.add_task("", total=1.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.stop()

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self.console.print(line, markup=False)

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
