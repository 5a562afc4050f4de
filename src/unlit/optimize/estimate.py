"""The unknowns of the optimisation, and their current values."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from ..scene.light import SphericalGaussians

mi = mitsuba()


@dataclass(frozen=True)
class Estimate:
    """The current answer. Maps live on the P pixels of the problem; Dr.Jit arrays, detached.

    vertices: mi.Point3f (V), world frame, cm. log_diffuse: mi.Color3f (P), ln of linear albedo.
    log_specular: mi.Float (P). perturbation: mi.Vector3f (P), world frame, no unit. axis:
    mi.Vector3f (K), near unit length, to the light; log_sharpness and log_amplitude: mi.Float (K),
    ln lambda and ln mu (radiance in the photo's linear values). Logarithms are natural. pull:
    mi.Color3f, right, below: mi.Vector4f, of width P: what the primal-dual solver of the maps goes
    on with (optimize/primal_dual.py); 0 where Adam follows them.
    """

    vertices: Any
    log_diffuse: Any
    log_specular: Any
    perturbation: Any
    axis: Any
    log_sharpness: Any
    log_amplitude: Any
    pull: Any
    right: Any
    below: Any

    def arrays(self) -> dict[str, np.ndarray]:
        """By name, float32: (N,) or (N, 3). `of` makes the same estimate of them."""
        rows = {field.name: getattr(self, field.name).numpy().T for field in fields(self)}
        return {name: np.ascontiguousarray(values) for name, values in rows.items()}

    @staticmethod
    def of(arrays: dict[str, np.ndarray]) -> Estimate:
        """The estimate of what `arrays` gave; nothing pulls where they do not say."""
        count = len(arrays["log_specular"])
        still = {"pull": 3, "right": 4, "below": 4}
        arrays = {n: np.zeros((count, c), np.float32) for n, c in still.items()} | arrays
        kinds = {"vertices": mi.Point3f, "log_diffuse": mi.Color3f}
        kinds |= {"perturbation": mi.Vector3f, "axis": mi.Vector3f}
        kinds |= {"pull": mi.Color3f, "right": mi.Vector4f, "below": mi.Vector4f}
        return Estimate(
            **{name: device(kinds.get(name, mi.Float), rows) for name, rows in arrays.items()}
        )

    def light(self) -> SphericalGaussians:
        """The lobes as NumPy arrays."""
        return SphericalGaussians(
            dr.normalize(self.axis).numpy().T.copy(),
            dr.exp(self.log_sharpness).numpy(),
            dr.exp(self.log_amplitude).numpy(),
        )

    def with_gain(self, gain: float) -> Estimate:
        """The same image explained by albedo times `gain` and light divided by it."""
        change = float(np.log(gain))
        return replace(
            self,
            log_diffuse=self.log_diffuse + change,
            log_specular=self.log_specular + change,
            log_amplitude=self.log_amplitude - change,
        )
