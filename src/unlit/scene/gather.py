"""Gather with a deterministic adjoint.

The adjoint of a gather adds into shared elements. Dr.Jit does that with atomics, in an order that
changes from run to run, and so do the last bits of every sum. Here the sum is a sparse product in
fixed order, so that two runs give the same bits.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from scipy import sparse

from .._runtime import mitsuba
from .arrays import device
from .linear import linear

mi = mitsuba()


class Gather:
    """Fixed indices (N,) into arrays of `size` elements."""

    def __init__(self, index: np.ndarray, size: int) -> None:
        self.index = device(mi.UInt32, index)
        count = len(index)
        ones = np.ones(count, dtype=np.float32)
        self._sum = sparse.csr_matrix((ones, (index, np.arange(count))), shape=(size, count))

    def __call__(self, source: Any) -> Any:
        """source[index], of the type of `source` (mi.Point3f, mi.Vector3f, ...); differentiable."""
        return linear(self.pick, self.add, source)

    def total(self, values: Any) -> Any:
        """For each of the `size` elements the sum of the `values` that belong to it."""
        return linear(self.add, self.pick, values)

    def pick(self, source: Any) -> Any:
        """The gather itself, without derivatives."""
        return dr.gather(type(source), source, self.index)

    def add(self, values: Any) -> Any:
        """The sum itself, without derivatives."""
        return device(type(values), self._sum @ values.numpy().T)
