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

from ..machine.runtime import mitsuba
from .arrays import device
from .cells import SphereCells
from .light import SphericalGaussians

mi = mitsuba()


def _nodes(cells: SphereCells) -> np.ndarray:
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
    """Sum of the lobes at given directions (J,), with respect to axis, sharpness and amplitude.

    Each loop reads four floats per step, stored together so that the read is one packet:
    mu exp(lambda (w . xi - 1)) = exp(w . (lambda xi) + (ln mu - lambda)).
    """

    def eval(self, axis: Any, sharpness: Any, amplitude: Any, directions: Any) -> Any:
        self.axis, self.sharpness, self.amplitude = axis, sharpness, amplitude
        self.directions = directions
        scaled = axis * sharpness
        record = mi.Vector4f(scaled.x, scaled.y, scaled.z, dr.log(amplitude) - sharpness)
        self.lobes = dr.ravel(record)
        dr.eval(self.lobes)
        count = dr.opaque(mi.UInt32, dr.width(sharpness))

        def body(k: Any, total: Any, w: Any) -> tuple[Any, Any, Any]:
            lobe = dr.gather(mi.Vector4f, self.lobes, k)
            return k + 1, total + dr.exp(dr.dot(w, lobe.xyz) + lobe.w), w

        n = dr.width(directions)
        state = (dr.zeros(mi.UInt32, n), dr.zeros(mi.Float, n), mi.Vector3f(directions))
        return dr.while_loop(state, lambda k, *_: k < count, body, labels=("k", "L", "w"))[1]

    def backward(self) -> None:
        w, g = self.directions, self.grad_out()
        dr.eval(g)
        nodes = dr.ravel(mi.Vector4f(w.x, w.y, w.z, g))
        dr.eval(nodes)
        count = dr.opaque(mi.UInt32, dr.width(w))
        lobes = dr.width(self.sharpness)
        lobe = dr.gather(mi.Vector4f, self.lobes, dr.arange(mi.UInt32, lobes))

        def body(j: Any, sum_g: Any, sum_w: Any, lobe: Any) -> tuple[Any, ...]:
            node = dr.gather(mi.Vector4f, nodes, j)
            value = node.w * dr.exp(dr.dot(node.xyz, lobe.xyz) + lobe.w)
            return j + 1, sum_g + value, sum_w + value * mi.Vector3f(node.xyz), lobe

        state = (dr.zeros(mi.UInt32, lobes), dr.zeros(mi.Float, lobes))
        state = (*state, dr.zeros(mi.Vector3f, lobes), lobe)
        _, sum_g, sum_w, _ = dr.while_loop(
            state, lambda j, *_: j < count, body, labels=("j", "g", "gw", "lobe")
        )
        self.set_grad_in("amplitude", sum_g / self.amplitude)
        self.set_grad_in("sharpness", dr.dot(sum_w, self.axis) - sum_g)
        self.set_grad_in("axis", self.sharpness * sum_w)


class CellRadiance:
    """Mean radiance per cell of a mixture of lobes, for one fixed set of D cells.

    nodes: mi.Vector3f of width 4 D, unit: where the lobes are evaluated.
    """

    def __init__(self, cells: SphereCells) -> None:
        nodes = _nodes(cells).reshape(-1, 3)
        self.count = len(cells)
        self.nodes = device(mi.Vector3f, nodes)

    def __call__(self, axis: Any, sharpness: Any, amplitude: Any) -> Any:
        """mi.Float of width D from unit axes (mi.Vector3f), sharpness and amplitude, width K."""
        radiance = dr.custom(_Radiance, axis, sharpness, amplitude, self.nodes)
        d = dr.arange(mi.UInt32, self.count)
        return 0.25 * sum(dr.gather(mi.Float, radiance, d + q * self.count) for q in range(4))

    def of(self, light: SphericalGaussians) -> np.ndarray:
        """The same for a finished light, (D,) float32."""
        return self(
            device(mi.Vector3f, light.axis),
            device(mi.Float, light.sharpness),
            device(mi.Float, light.amplitude),
        ).numpy()
