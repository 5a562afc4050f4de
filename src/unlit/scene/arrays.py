"""NumPy to Dr.Jit, in one way only; and three of Dr.Jit's functions, typed.

On the CPU Dr.Jit wraps NumPy's memory as it lies. An odd alignment, and the offsets of x, y, z in
one block, then become part of every kernel that reads the array, and each photo would have
hundreds of kernels compiled anew. Copies into aligned memory, one per component, avoid that.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba

mi = mitsuba()

_ALIGNMENT = 64


def _aligned(values: np.ndarray, kind: Any) -> np.ndarray:
    """Copy of `values` (N,) as `kind` at an address that is a multiple of 64."""
    size = np.dtype(kind).itemsize
    raw = np.empty(values.size * size + _ALIGNMENT, dtype=np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT
    out = raw[start : start + values.size * size].view(kind)
    out[:] = values
    return out


def device(kind: Any, values: np.ndarray) -> Any:
    """Dr.Jit array of type `kind` (mi.Float, mi.UInt32, mi.Vector3f, mi.Color3f, ...).

    values: (N,) for a scalar type, (N, C) for one of C components.
    """
    values = np.asarray(values)
    if values.ndim == 1:
        number = np.uint32 if dr.type_v(kind) == dr.VarType.UInt32 else np.float32
        return kind(_aligned(values, number))
    scalar = mi.UInt32 if dr.type_v(kind) == dr.VarType.UInt32 else mi.Float
    return kind(*(device(scalar, column) for column in values.T))


def at_least(value: Any, least: float) -> Any:
    """`value`, or `least` where it is lower or no number."""
    return dr.fmax(value, least)


def at_most(value: Any, most: Any) -> Any:
    """`value`, or `most` where it is higher or no number."""
    return dr.fmin(value, most)


def where(mask: Any) -> Any:
    """Indices (mi.UInt32) of the elements of `mask` (mi.Bool) that are set."""
    return dr.compress(mask)
