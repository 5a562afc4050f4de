"""metrics.json: how the run went, and the figures that its steps found."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import msgspec

from ..errors import OutputError
from ..face.conditions import LightEstimate
from ..face.reconstruction import Metrics, Reconstruction
from ..storage.tables import explained, read_bytes

_LIMIT = 16 << 20


@dataclass(frozen=True)
class MetricsFile:
    """The file's content: Metrics, FittedHead's residual and model, and what was found of the
    light. unit_cd_m2: luminance of the photo's linear value 1.
    """

    losses: dict[str, list[tuple[int, float | None]]]
    seconds: dict[str, float]
    peak_memory_mb: float
    warnings: tuple[str, ...] = ()
    continued_from_stage: int | None = None
    landmark_residual: float | None = None
    head_model: str | None = None
    unit_cd_m2: float | None = None
    light_color: LightEstimate | None = None

    def metrics(self) -> Metrics:
        """The part that `Reconstruction.metrics` has."""
        own: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(Metrics)}
        own["losses"] = {name: _numbers(pairs) for name, pairs in self.losses.items()}
        return Metrics(**own)


def _numbers(pairs: list[tuple[int, float | None]]) -> list[tuple[int, float]]:
    """JSON has no NaN and no infinity: a loss that was one is null there."""
    return [(iteration, math.nan if loss is None else loss) for iteration, loss in pairs]


def metrics_json(r: Reconstruction) -> str:
    """The file's text."""
    file = MetricsFile(
        **vars(r.metrics),
        landmark_residual=r.head.landmark_residual,
        head_model=r.head.model,
        unit_cd_m2=r.photo.white_luminance,
        light_color=r.conditions.light_estimate,
    )
    return msgspec.json.format(msgspec.json.encode(file), indent=1).decode() + "\n"


def read_metrics(path: Path) -> MetricsFile:
    """The content of `path`. Raises OutputError."""
    content = read_bytes(path, OutputError, _LIMIT)
    try:
        return msgspec.json.decode(content, type=MetricsFile)
    except (msgspec.DecodeError, RecursionError) as error:
        what = f"not valid ({explained(error)})"
        raise OutputError(f"{path}: {what}; reconstruct the photo again") from error
