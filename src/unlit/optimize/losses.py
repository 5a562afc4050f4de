"""The terms of the loss (paper, equations 1 to 5), on Dr.Jit arrays.

Each is a mean over pixels or vertices. The image is compared in sRGB-encoded values; smoothness is
the total variation of encoded diffuse albedo and of log specular albedo (docs/method.md, "Losses").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..color import UNCLIPPED
from ..machine.runtime import mitsuba
from ..scene.arrays import at_least, device

mi = mitsuba()


def encode(linear: Any) -> Any:
    """sRGB encoding of non-negative linear values; the power continues above 1."""
    linear = at_least(linear, 1e-5)
    return dr.select(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def censored(encoded: Any) -> Any:
    """Encoded colours as the photo would record them: clipped to UNCLIPPED.

    Comparing censored values on both sides leaves saturated and crushed pixels out of the loss
    as long as the render is saturated or crushed there too, and only so long.
    """
    return dr.clip(encoded, *UNCLIPPED)


def image_l1(render: Any, target: Any, weight: Any) -> Any:
    """Weighted mean absolute difference of encoded colours.

    render: mi.Color3f linear, width P; target: mi.Color3f, encoded and censored; weight:
    mi.Float, sum 1.
    """
    difference = dr.abs(censored(encode(render)) - target)
    return dr.sum(weight * (difference.x + difference.y + difference.z)) / 3


def _count(values: Any, channels: int = 1) -> Any:
    """Number of elements; opaque, or every photo would have its own compiled kernels."""
    return dr.opaque(mi.Float, channels * dr.width(values))


@dataclass(frozen=True)
class Neighbours:
    """For each of P pixels, the indices of the pixels right of, below, left of and above it.

    A pixel without such a neighbour inside the mask points to itself: no difference, no cost.
    """

    right: Any
    below: Any
    left: Any
    above: Any

    @staticmethod
    def of(pixel: np.ndarray, width: int, height: int) -> Neighbours:
        """From row-major pixel indices (P,) of an image of `width` x `height`."""
        lookup = np.full(width * (height + 2), -1, dtype=np.int64)
        inside = pixel + width  # a row of nothing above and below
        lookup[inside] = np.arange(len(pixel))
        right = np.where(pixel % width == width - 1, -1, lookup[inside + 1])
        left = np.where(pixel % width == 0, -1, lookup[inside - 1])
        around = (right, lookup[inside + width], left, lookup[inside - width])
        own = np.arange(len(pixel))
        return Neighbours(*(device(mi.UInt32, np.where(n < 0, own, n)) for n in around))


def total_variation(values: Any, neighbours: Neighbours) -> Any:
    """Mean over pixels (and channels) of |difference to the right| + |difference below|."""
    channels = [values] if isinstance(values, mi.Float) else list(values)
    total = sum(dr.sum(dr.custom(_Variation, channel, neighbours)) for channel in channels)
    return total / _count(values, len(channels))


class _Variation(dr.CustomOp):
    """|difference to the right| + |difference below| per pixel.

    Its adjoint is gathered from the neighbours on all four sides: the automatic one would scatter
    with atomics, slower and not the same in every run.
    """

    def eval(self, values: Any, neighbours: Neighbours) -> Any:
        self.values, self.neighbours = values, neighbours
        right, below = (
            dr.abs(dr.gather(mi.Float, values, n) - values)
            for n in (neighbours.right, neighbours.below)
        )
        return right + below

    def backward(self) -> None:
        values, g, n = self.values, self.grad_out(), self.neighbours

        def slope(index: Any) -> Any:
            difference = values - dr.gather(mi.Float, values, index)
            return dr.select(difference == 0, 0, dr.sign(difference))

        def of(index: Any) -> Any:
            return dr.gather(mi.Float, g, index)

        own = g * (slope(n.right) + slope(n.below))
        self.set_grad_in("values", own + of(n.left) * slope(n.left) + of(n.above) * slope(n.above))


def landmark_l2(projected: Any, detected: Any, weight: Any, size: float) -> Any:
    """Weighted mean squared distance of landmarks, in units of `size` pixels.

    projected, detected: mi.Point2f, pixels; weight: mi.Float, sum 1.
    """
    return dr.sum(weight * dr.squared_norm((projected - detected) / size))


def shape_l2(vertices: Any, start: Any, unit: float) -> Any:
    """Mean squared distance of the vertices from the fitted mesh, in units of `unit` cm."""
    return dr.sum(dr.squared_norm((vertices - start) / unit)) / _count(vertices)


def normal_l2(perturbation: Any) -> Any:
    """Mean squared norm of the normal perturbation (paper, section 3.4)."""
    return dr.sum(dr.squared_norm(perturbation)) / _count(perturbation)


def gloss_l1(log_specular: Any, nominal: Any, s: Any, weight: Any) -> Any:
    """Weighted mean of |rho_s - nominal| S: gloss that departs from a clean skin surface's.

    s: mi.Float or mi.Color3f, width P.
    """
    return dr.sum(weight * dr.abs(dr.exp(log_specular) - nominal) * dr.mean(mi.Color3f(s)))
