"""The corners of triangles, with a deterministic adjoint.

The adjoint of a gather adds into shared elements. Dr.Jit does that with atomics, in an order that
changes from run to run, and so do the last bits of every sum. Here the sum is a sparse product in
fixed order, so that two runs give the same bits.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from scipy import sparse

from ..machine.runtime import mitsuba
from .arrays import device
from .linear import linear

mi = mitsuba()


class Corners:
    """Triangles (F, 3) as indices into arrays of V elements.

    index: of the three corners, mi.UInt32 of width F each.
    """

    def __init__(self, triangles: np.ndarray, vertices: int) -> None:
        triangles = np.asarray(triangles)
        self.index = [device(mi.UInt32, column) for column in triangles.T]
        faces, element = len(triangles), np.arange(triangles.size)
        ones = np.ones(triangles.size, dtype=np.float32)
        self._sum = sparse.csr_matrix(
            (ones, (triangles.T.ravel(), element)), shape=(vertices, triangles.size)
        )
        self._total = sparse.csr_matrix(
            (ones, (triangles.T.ravel(), np.tile(np.arange(faces), 3))), shape=(vertices, faces)
        )

    def __call__(self, *sources: Any) -> list[Any]:
        """The three corners' values (a, b, c) of each source; differentiable.

        sources: mi.Point3f, mi.Vector3f, ... of width V; each result has width F. Ask for several
        at once: what a loss says of all of them is then computed once, and not once for each.
        """
        return linear(self._pick, self._add, list(sources))

    def total(self, values: Any) -> Any:
        """For each of the V elements the sum over its triangles of `values` (F); differentiable."""
        return linear(self._around, self._spread, values)

    def _pick(self, sources: list[Any]) -> list[Any]:
        return [tuple(dr.gather(type(s), s, i) for i in self.index) for s in sources]

    def _add(self, corners: list[Any]) -> list[Any]:
        dr.eval(corners)
        rows = [np.hstack([corner.numpy() for corner in of]).T for of in corners]
        sums = np.hsplit(self._sum @ np.hstack(rows), len(rows))
        return [device(type(of[0]), s) for of, s in zip(corners, sums, strict=True)]

    def _around(self, values: Any) -> Any:
        return device(type(values), self._total @ values.numpy().T)

    def _spread(self, elements: Any) -> Any:
        return sum(dr.gather(type(elements), elements, i) for i in self.index)
