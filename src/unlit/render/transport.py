"""The deterministic transport renderer.

The light is distant and the albedo lives in image space, so at fixed geometry a point p of the
face is shaded by two numbers that are linear in the light L (one mean radiance per cell d):

    E(p) = sum_d V(p, d) max(n_d . m_d, 0) / pi L_d          (m_d: the cell's first moment)
    S(p) = sum_d V(p, d) f_s(p, w_d) max(n_s . w_d, 0) dw_d L_d
    I(p) = rho_d(p) E(p) + rho_s(p) S(p)

This is precomputed radiance transfer (Sloan et al. 2002) used for inverse rendering. Two forms of
it are here: `shade` sums over the cells of any light, exactly; `Transport` keeps a low-rank
factorisation E = U_E (W_E L), S = U_S (W_S L) whose product and transposed product make one
iteration of the optimisation cheap; `linearize` gives the change of E and S with the normal.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import numpy as np

from .._runtime import mitsuba
from ..scene.brdf import specular
from ..scene.cells import Cells
from .visibility import trace, visible

mi = mitsuba()


@dataclass(frozen=True)
class Points:
    """P shading points of the face, Dr.Jit arrays of width P in the world frame (cm).

    position: mi.Point3f. diffuse_normal, specular_normal: unit mi.Vector3f. geometric: unit
    normal of the triangle. roughness: mi.Float, Beckmann alpha. The viewer is at the origin.
    """

    position: Any
    diffuse_normal: Any
    specular_normal: Any
    geometric: Any
    roughness: Any

    def __len__(self) -> int:
        return dr.width(self.position)

    def gather(self, index: Any) -> Points:
        """The points at `index` (mi.UInt32)."""
        return Points(
            *(dr.gather(type(v), v, index) for v in (getattr(self, f.name) for f in fields(self)))
        )

    @property
    def to_viewer(self) -> Any:
        return -dr.normalize(mi.Vector3f(self.position))


class Directions:
    """The quadrature on the device: unit directions, first moments / pi, and solid angles."""

    def __init__(self, cells: Cells) -> None:
        self.unit = mi.Vector3f(np.ascontiguousarray(cells.direction.T, dtype=np.float32))
        self.moment = mi.Vector3f(np.ascontiguousarray(cells.moment.T / np.pi, dtype=np.float32))
        self.solid_angle = mi.Float(cells.solid_angle.astype(np.float32))

    def __len__(self) -> int:
        return dr.width(self.solid_angle)


def visibility(scene: Any, points: Points, directions: Directions) -> Any:
    """Visibility bits of `points`; see visibility.trace."""
    return trace(
        scene, points.position, points.specular_normal, points.geometric, directions.unit
    )


def _terms(points: Points, directions: Directions, bits: Any, point: Any, d: Any) -> tuple[Any, Any]:
    """Diffuse and specular transport between points `point` and cells `d` (UInt32 indices)."""
    seen = visible(bits, len(points), point, d)
    diffuse_normal = dr.gather(mi.Vector3f, points.diffuse_normal, point)
    normal = dr.gather(mi.Vector3f, points.specular_normal, point)
    viewer = dr.gather(mi.Vector3f, points.to_viewer, point)
    alpha = dr.gather(mi.Float, points.roughness, point)
    towards = dr.gather(mi.Vector3f, directions.unit, d)
    diffuse = dr.fmax(dr.dot(diffuse_normal, dr.gather(mi.Vector3f, directions.moment, d)), 0)
    lobe = specular(normal, towards, viewer, alpha)
    lobe *= dr.gather(mi.Float, directions.solid_angle, d)
    return dr.select(seen, diffuse, 0), dr.select(seen, lobe, 0)


def shade(points: Points, directions: Directions, bits: Any, radiance: np.ndarray) -> tuple[Any, Any]:
    """Direct shading (E, S) of every point under `radiance` (D,) or (D, 3), exactly.

    Returns mi.Float of width P for a monochrome light, mi.Color3f for a coloured one.
    Differentiable in forward mode with respect to normals and roughness.
    """
    colour = mi.Color3f if np.ndim(radiance) == 2 else mi.Float
    light = colour(np.ascontiguousarray(np.asarray(radiance, dtype=np.float32).T))
    lit = np.flatnonzero(np.asarray(radiance).reshape(len(directions), -1).max(axis=1) > 0)
    order = mi.UInt32(lit.astype(np.uint32))
    steps = dr.opaque(mi.UInt32, len(lit))
    point = dr.arange(mi.UInt32, len(points))

    def body(k: Any, e: Any, s: Any) -> tuple[Any, Any, Any]:
        d = dr.gather(mi.UInt32, order, k)
        diffuse, lobe = _terms(points, directions, bits, point, d)
        value = dr.gather(colour, light, d)
        return k + 1, e + value * diffuse, s + value * lobe

    zero = dr.zeros(colour, len(points))
    state = (dr.zeros(mi.UInt32, len(points)), zero, colour(zero))
    _, e, s = dr.while_loop(state, lambda k, *_: k < steps, body, labels=("k", "e", "s"))
    return e, s


@dataclass(frozen=True)
class Linearization:
    """First-order shading about the normals n0: E0 + B . (n_d - n0_d), S0 + C . (n_s - n0_s)."""

    diffuse: Any
    specular: Any
    diffuse_gradient: Any
    specular_gradient: Any
    diffuse_normal: Any
    specular_normal: Any

    def shade(self, diffuse_normal: Any, specular_normal: Any) -> tuple[Any, Any]:
        """(E, S) at nearby unit normals, differentiable; never negative."""
        e = self.diffuse + dr.dot(self.diffuse_gradient, diffuse_normal - self.diffuse_normal)
        s = self.specular + dr.dot(self.specular_gradient, specular_normal - self.specular_normal)
        return dr.fmax(e, 0), dr.fmax(s, 0)


def linearize(
    points: Points, directions: Directions, bits: Any, radiance: np.ndarray
) -> Linearization:
    """Shading under a monochrome `radiance` (D,) and its derivative along both normals.

    The derivative is taken in the tangent plane by forward-mode differentiation of `shade`;
    visibility is held fixed.
    """
    zero = dr.zeros(mi.Vector3f, len(points))
    gradient_e, gradient_s = zero, mi.Vector3f(zero)
    e = s = mi.Float(0)
    frames = (mi.Frame3f(points.diffuse_normal), mi.Frame3f(points.specular_normal))
    for tangents in ((frames[0].s, frames[1].s), (frames[0].t, frames[1].t)):
        diffuse_normal = mi.Vector3f(points.diffuse_normal)
        specular_normal = mi.Vector3f(points.specular_normal)
        dr.enable_grad(diffuse_normal, specular_normal)
        moved = Points(
            points.position, diffuse_normal, specular_normal, points.geometric, points.roughness
        )
        e, s = shade(moved, directions, bits, radiance)
        dr.set_grad(diffuse_normal, tangents[0])
        dr.set_grad(specular_normal, tangents[1])
        dr.forward_to(e, s)
        gradient_e = gradient_e + tangents[0] * dr.grad(e)
        gradient_s = gradient_s + tangents[1] * dr.grad(s)
        e, s = dr.detach(e), dr.detach(s)
        dr.eval(gradient_e, gradient_s, e, s)
    return Linearization(
        e, s, gradient_e, gradient_s, points.diffuse_normal, points.specular_normal
    )


def _rows(points: Points, directions: Directions, bits: Any, chosen: np.ndarray) -> tuple[Any, Any]:
    """Exact transport rows (n, D), float32, of the points `chosen` (n,): diffuse and specular."""
    count = len(directions)
    index = dr.arange(mi.UInt32, len(chosen) * count)
    point = dr.gather(mi.UInt32, mi.UInt32(chosen.astype(np.uint32)), index // count)
    diffuse, lobe = _terms(points, directions, bits, point, index % count)
    dr.eval(diffuse, lobe)
    return (
        diffuse.numpy().reshape(len(chosen), count),
        lobe.numpy().reshape(len(chosen), count),
    )


def _basis(rows: np.ndarray, rank: int) -> np.ndarray:
    """Orthonormal basis (rank, D) of the rows' dominant row space."""
    gram = (rows.T @ rows).astype(np.float64)
    rank = min(rank, len(gram))
    _, vectors = np.linalg.eigh(gram)
    return np.ascontiguousarray(vectors[:, ::-1][:, :rank].T.astype(np.float32))


class Product:
    """y = U x and its transpose for a tall (P, R) float32 matrix; the hot loop of stages 1 to 3.

    On the CPU two halves go through BLAS in two threads, measured 3 times faster than the same
    loop in a Dr.Jit kernel, whose gathers cannot be vector loads; elsewhere Dr.Jit does it.
    """

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix = np.ascontiguousarray(matrix, dtype=np.float32)
        self.device = None if dr.backend_v(mi.Float) == dr.JitBackend.LLVM else mi.TensorXf(matrix)

    def apply(self, x: Any) -> Any:
        """U x: mi.Float of width R to mi.Float of width P."""
        if self.device is not None:
            return dr.sum(self.device * mi.TensorXf(x, (1, dr.width(x))), axis=1).array
        vector = x.numpy()
        return mi.Float(np.concatenate(_halves(lambda part: part @ vector, self.matrix)))

    def apply_transposed(self, y: Any) -> Any:
        """U^T y: mi.Float of width P to mi.Float of width R."""
        if self.device is not None:
            return dr.sum(self.device * mi.TensorXf(y, (dr.width(y), 1)), axis=0).array
        vector = y.numpy()
        half = len(vector) // 2
        parts = (vector[:half], vector[half:])
        a, b = _POOL.map(
            lambda pair: pair[1] @ pair[0],
            ((self.matrix[:half], parts[0]), (self.matrix[half:], parts[1])),
        )
        return mi.Float(a + b)


_POOL = ThreadPoolExecutor(2, thread_name_prefix="unlit-blas")


def _halves(function: Any, matrix: np.ndarray) -> list[np.ndarray]:
    half = len(matrix) // 2
    return list(_POOL.map(function, (matrix[:half], matrix[half:])))


class _Multiply(dr.CustomOp):
    """`Product` with its adjoint, as one differentiable Dr.Jit operation."""

    def eval(self, product: Product, x: Any) -> Any:
        self.product = product
        return product.apply(x)

    def forward(self) -> None:
        self.set_grad_out(self.product.apply(self.grad_in("x")))

    def backward(self) -> None:
        self.set_grad_in("x", self.product.apply_transposed(self.grad_out()))


class Transport:
    """Low-rank transport of P points: E and S as differentiable functions of the cells' radiance.

    rank: number of basis vectors for the diffuse and the specular part. The bases are those of
    the exact transport of an even sample of the points; each point is then projected on them.
    """

    def __init__(
        self,
        points: Points,
        directions: Directions,
        bits: Any,
        rank: tuple[int, int],
        sample: int = 6000,
        block: int = 8192,
    ) -> None:
        chosen = np.unique(np.linspace(0, len(points) - 1, sample).astype(np.int64))
        self.basis = [
            _basis(rows, r) for rows, r in zip(_rows(points, directions, bits, chosen), rank, strict=True)
        ]
        factors = [np.empty((len(points), len(b)), dtype=np.float32) for b in self.basis]
        for start in range(0, len(points), block):  # bounds memory: never all P x D at once
            part = np.arange(start, min(start + block, len(points)))
            for factor, basis, rows in zip(
                factors, self.basis, _rows(points, directions, bits, part), strict=True
            ):
                np.matmul(rows, basis.T, out=factor[part[0] : part[-1] + 1])
        self._factors = [Product(f) for f in factors]
        self._bases = [Product(b) for b in self.basis]

    def shade(self, radiance: Any) -> tuple[Any, Any]:
        """(E, S), mi.Float of width P, for `radiance` mi.Float of width D; differentiable."""
        e, s = (
            dr.custom(_Multiply, factor, dr.custom(_Multiply, basis, radiance))
            for factor, basis in zip(self._factors, self._bases, strict=True)
        )
        return e, s
