"""Gaussian blur of values that live on the P pixels of the mask, as a differentiable operation.

Turns the specular normal's perturbation into the diffuse normal's (paper, section 3.4). Outside
the mask the perturbation is zero, so the blur is a symmetric matrix and its own adjoint.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.arrays import device
from ..scene.linear import linear
from ..scene.maps import kernel

mi = mitsuba()


class Blur:
    """pixel: (P,) row-major indices into an image of `width` x `height`; sigma in pixels."""

    def __init__(self, pixel: np.ndarray, width: int, height: int, sigma: float) -> None:
        self.pixel = device(mi.UInt32, pixel)
        self.width, self.height = width, height
        self.taps = [(k - len(kernel(sigma)) // 2, float(w)) for k, w in enumerate(kernel(sigma))]

    def __call__(self, values: Any) -> Any:
        """Blur mi.Vector3f of width P; differentiable."""
        return linear(self.apply, self.apply, values)

    def apply(self, values: Any) -> Any:
        """The blur itself, without derivatives."""
        image = dr.zeros(mi.Vector3f, self.width * self.height)
        for axis in range(3):
            dr.scatter(image[axis], values[axis], self.pixel)
        dr.eval(image)
        index = dr.arange(mi.Int32, self.width * self.height)
        across = self._pass(image, index, index % self.width, self.width, 1)
        dr.eval(across)
        own = mi.Int32(self.pixel)
        return self._pass(across, own, own // self.width, self.height, self.width)

    def _pass(self, image: Any, index: Any, position: Any, size: int, stride: int) -> Any:
        total = mi.Vector3f(0)
        for offset, weight in self.taps:
            inside = (position + offset >= 0) & (position + offset < size)
            total += weight * dr.gather(mi.Vector3f, image, index + offset * stride, inside)
        return total
