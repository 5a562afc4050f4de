"""Values per region, blended by the regions' soft masks, as a differentiable operation.

The base colours of stage 1 (paper, section 3.1). Written out because the automatic adjoint of
reading so few numbers from so many pixels is a reduction per region and channel.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from ..scene.linear import linear

mi = mitsuba()


class Blend:
    """masks: (P, R) shares of R regions in P pixels."""

    def __init__(self, masks: np.ndarray) -> None:
        self.masks = np.ascontiguousarray(masks, dtype=np.float32)
        self.device = [device(mi.Float, column) for column in self.masks.T]

    def __call__(self, *values: Any) -> list[Any]:
        """Each of `values` (mi.Float, mi.Color3f, ... of width R) at the P pixels."""
        return linear(self._apply, self._adjoint, list(values))

    def _apply(self, values: list[Any]) -> list[Any]:
        return [
            sum(m * dr.gather(type(v), v, mi.UInt32(k)) for k, m in enumerate(self.device))
            for v in values
        ]

    def _adjoint(self, blended: list[Any]) -> list[Any]:
        dr.eval(blended)
        return [device(type(v), (v.numpy() @ self.masks).T) for v in blended]
