"""The light's lobes as the optimiser sees them: mean radiance per cell, differentiable.

    L(d) = mean over cell d of sum_k mu_k exp(lambda_k (w . xi_k - 1))

The mean is a Gauss-Legendre rule of 2 x 2 points per cell (in cos theta and phi): exact for cubic
integrands, so a lobe as narrow as its cell keeps its flux. Forward and adjoint are each one
kernel, written out because automatic differentiation would store all K x 4D exponentials.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from .._runtime import mitsuba
from .cells import Cells
from .light import SphericalGaussians

mi = mitsuba()


def _nodes(cells: Cells) -> np.ndarray:
    """Unit directions (4, D, 3) of the Gauss-Legendre points of each cell; equal weights."""
    offset = 0.5 / np.sqrt(3)
    z = np.cos(cells.theta)
    nodes = []
    for a in (-offset, offset):
        cosine = (0.5 - a) * z[:, 0] + (0.5 + a) * z[:, 1]
        sine = np.sqrt(1 - cosine**2)
        for b in (-offset, offset):
            phi = (0.5 - b) * cells.phi[:, 0] + (0.5 + b) * cells.phi[:, 1]
            nodes.append(np.stack([np.sin(phi) * sine, cosine, -np.cos(phi) * sine], axis=1))
    return np.stack(nodes)


class _Radiance(dr.CustomOp):
    """Sum of the lobes at given directions (J,), with respect to axis, sharpness and amplitude."""

    def eval(self, axis: Any, sharpness: Any, amplitude: Any, directions: Any) -> Any:
        self.axis, self.sharpness, self.amplitude = axis, sharpness, amplitude
        self.directions = directions
        lobes = dr.opaque(mi.UInt32, dr.width(sharpness))

        def body(k: Any, total: Any, w: Any) -> tuple[Any, Any, Any]:
            xi = dr.gather(mi.Vector3f, axis, k)
            exponent = dr.gather(mi.Float, sharpness, k) * (dr.dot(w, xi) - 1)
            return k + 1, total + dr.gather(mi.Float, amplitude, k) * dr.exp(exponent), w

        count = dr.width(directions)
        state = (dr.zeros(mi.UInt32, count), dr.zeros(mi.Float, count), mi.Vector3f(directions))
        return dr.while_loop(state, lambda k, *_: k < lobes, body, labels=("k", "L", "w"))[1]

    def backward(self) -> None:
        gradient = self.grad_out()
        dr.eval(gradient)
        directions = self.directions
        count = dr.opaque(mi.UInt32, dr.width(directions))

        def body(j: Any, a: Any, b: Any, c: Any, xi: Any, lam: Any) -> tuple[Any, ...]:
            w = dr.gather(mi.Vector3f, directions, j)
            cosine = dr.dot(w, xi) - 1
            g = dr.gather(mi.Float, gradient, j) * dr.exp(lam * cosine)
            return j + 1, a + g, b + g * cosine, c + g * w, xi, lam

        lobes = dr.width(self.sharpness)
        state = (
            dr.zeros(mi.UInt32, lobes),
            dr.zeros(mi.Float, lobes),
            dr.zeros(mi.Float, lobes),
            dr.zeros(mi.Vector3f, lobes),
            mi.Vector3f(self.axis),
            mi.Float(self.sharpness),
        )
        _, to_amplitude, to_sharpness, to_axis, _, _ = dr.while_loop(
            state, lambda j, *_: j < count, body, labels=("j", "a", "b", "c", "xi", "lam")
        )
        self.set_grad_in("amplitude", to_amplitude)
        self.set_grad_in("sharpness", self.amplitude * to_sharpness)
        self.set_grad_in("axis", self.amplitude * self.sharpness * to_axis)


class CellRadiance:
    """Mean radiance per cell of a mixture of lobes, for one fixed set of cells."""

    def __init__(self, cells: Cells) -> None:
        nodes = _nodes(cells).reshape(-1, 3)
        self.count = len(cells)
        self.nodes = mi.Vector3f(np.ascontiguousarray(nodes.T, dtype=np.float32))

    def __call__(self, axis: Any, sharpness: Any, amplitude: Any) -> Any:
        """mi.Float of width D from unit axes (mi.Vector3f), sharpness and amplitude, width K."""
        radiance = dr.custom(_Radiance, axis, sharpness, amplitude, self.nodes)
        d = dr.arange(mi.UInt32, self.count)
        return 0.25 * sum(dr.gather(mi.Float, radiance, d + q * self.count) for q in range(4))

    def of(self, light: SphericalGaussians) -> np.ndarray:
        """The same for a finished light, (D,) float32."""
        return self(
            mi.Vector3f(np.ascontiguousarray(light.axis.T)),
            mi.Float(light.sharpness),
            mi.Float(light.amplitude),
        ).numpy()
