"""What is kept of a run as it goes: losses by stage, seconds by step."""

from __future__ import annotations

import time

from ..progress.callbacks import StageProgress


class RunRecord:
    """Call it with (stage, iteration, iterations, loss); it passes that on to `progress`.

    losses, seconds: as in Metrics.
    """

    def __init__(self, progress: StageProgress) -> None:
        self.losses: dict[str, list[tuple[int, float]]] = {}
        self.seconds: dict[str, float] = {}
        self.progress = progress
        self._last = time.perf_counter()

    def __call__(self, stage: str, iteration: int, iterations: int, loss: float) -> None:
        self.losses.setdefault(stage, []).append((iteration - 1, loss))
        self.progress(stage, iteration, iterations, loss)

    def begins(self, step: str) -> None:
        """Tell `progress` what comes next."""
        self.progress(step, 0, 1, 0.0)

    def lap(self, step: str) -> None:
        """The time since the last lap belongs to `step`."""
        now = time.perf_counter()
        self.seconds[step] = self.seconds.get(step, 0.0) + now - self._last
        self._last = now
