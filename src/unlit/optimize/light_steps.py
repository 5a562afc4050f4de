"""The light of one stage, and the steps by which it follows the loss."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.cells import SphereCells
from ..scene.lobes import CellRadiance
from ..settings.settings import Settings
from ..settings.table1 import Stage
from .estimate import Estimate
from .optimizer import Adam

mi = mitsuba()


class LightSteps:
    """The lobes of `estimate`, which Adam moves at the rates of `stage`.

    steps: of Adam in each iteration of the stage: in one call of `follow`, or by `step`.
    """

    def __init__(
        self, settings: Settings, stage: Stage, estimate: Estimate, cells: SphereCells, steps: int
    ) -> None:
        self.settings, self.steps = settings, steps
        rates = {
            "axis": stage.axis_rate,
            "log_sharpness": stage.sharpness_rate,
            "log_amplitude": stage.amplitude_rate,
        }
        lobes = {name: getattr(estimate, name) for name in rates}
        self._adam = Adam.of(settings, lobes, rates, steps * stage.iterations)
        self._cells = CellRadiance(cells)

    @property
    def radiance(self) -> Any:
        """Mean radiance of each of the D cells (mi.Float, D), as a function of the lobes."""
        adam = self._adam
        axis, sharpness = dr.normalize(adam["axis"]), dr.exp(adam["log_sharpness"])
        return self._cells(axis, sharpness, dr.exp(adam["log_amplitude"]))

    @property
    def known(self) -> Any:
        """The same, detached."""
        return dr.detach(self.radiance)

    def follow(self, loss: Callable[[Any], Any]) -> None:
        """Steps down of `loss`, a function of the radiance; none where no rate is above 0."""
        for _ in range(self.steps if self._adam.rates else 0):
            dr.backward(loss(self.radiance))
            self.step()

    def step(self) -> None:
        """One step of Adam along the gradients that the lobes have, which stay in their range."""
        adam, settings = self._adam, self.settings
        adam.step()
        if "axis" in adam.rates:
            adam["axis"] = dr.normalize(adam["axis"])
        if "log_sharpness" in adam.rates:
            low, high = np.log(settings.min_sharpness), np.log(settings.max_sharpness)
            adam["log_sharpness"] = dr.clip(adam["log_sharpness"], low, high)

    def brighten(self, shift: float) -> None:
        """Radiance times exp(shift)."""
        value = dr.detach(self._adam["log_amplitude"])
        self._adam["log_amplitude"] = value + dr.opaque(mi.Float, shift)

    def lobes(self) -> dict[str, Any]:
        """As the estimate has them, by its names."""
        return {name: dr.detach(value) for name, value in self._adam.values.items()}
