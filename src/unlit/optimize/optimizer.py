"""Adam with the paper's element-wise gradient clipping and a cosine-decayed rate.

Kingma & Ba 2015 with beta 0.9 / 0.999 (paper, section 4); `uniform` divides by the largest second
moment instead of each element's own, as Nicolet et al. 2021 ask for preconditioned vertices.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

from ..machine.runtime import mitsuba
from ..settings.settings import Settings

mi = mitsuba()


class Adam:
    """Named Dr.Jit parameters, each with its own rate; `step` reads their gradients.

    parameters: name -> array (mi.Float, mi.Vector3f, ...). rates: name -> rate; a rate of 0
    freezes the parameter. hold: share of `iterations` at the full rate, below 1, before it decays.
    floor: share of the rate left at the end. clip: bound of each gradient element. uniform: names
    that share one second moment.
    """

    def __init__(
        self,
        parameters: dict[str, Any],
        rates: dict[str, float],
        iterations: int,
        hold: float,
        floor: float,
        clip: float,
        uniform: frozenset[str] = frozenset(),
    ) -> None:
        self.rates = {name: rate for name, rate in rates.items() if rate > 0}
        self.iterations, self.hold, self.floor = iterations, hold, floor
        self.clip, self.uniform = clip, uniform
        self.values: dict[str, Any] = {}
        self.moments = {
            name: (dr.zeros(type(p), dr.width(p)), dr.zeros(type(p), dr.width(p)))
            for name, p in parameters.items()
            if name in self.rates
        }
        self.taken = 0
        for name, value in parameters.items():
            self[name] = value

    @staticmethod
    def of(
        settings: Settings,
        parameters: dict[str, Any],
        rates: dict[str, float],
        iterations: int,
        uniform: frozenset[str] = frozenset(),
    ) -> Adam:
        """With the decay and the clipping of `settings`."""
        hold, floor = settings.rate_hold, settings.rate_floor
        return Adam(parameters, rates, iterations, hold, floor, settings.clip, uniform)

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def __setitem__(self, name: str, value: Any) -> None:
        value = type(value)(dr.detach(value))
        if name in self.rates:
            dr.enable_grad(value)
        self.values[name] = value

    def step(self) -> None:
        """One update of every parameter that has a rate."""
        self.taken += 1
        done = min(1.0, (self.taken - 1) / max(1, self.iterations - 1))
        share = max(0.0, done - self.hold) / (1 - self.hold)
        decay = self.floor + (1 - self.floor) * 0.5 * (1 + math.cos(math.pi * share))
        correction = math.sqrt(1 - 0.999**self.taken) / (1 - 0.9**self.taken)
        changed = []
        for name, rate in self.rates.items():
            value = self.values[name]
            gradient = dr.clip(dr.grad(value), -self.clip, self.clip)
            first, second = self.moments[name]
            first = 0.9 * first + 0.1 * gradient
            second = 0.999 * second + 0.001 * dr.square(gradient)
            self.moments[name] = (first, second)
            scale = dr.max(dr.max(second), axis=None) if name in self.uniform else second
            # Opaque: the rate changes each time, the compiled kernel must not.
            pace = dr.opaque(mi.Float, rate * decay * correction)
            self[name] = dr.detach(value) - pace * first / (dr.sqrt(scale) + 1e-8)
            changed += [self.values[name], first, second]
        dr.eval(*changed)
