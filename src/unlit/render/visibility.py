"""Self-shadowing: which directions of light reach which point of the face.

One shadow ray per point and cell of the quadrature (scene/cells.py), traced by Mitsuba, kept as
one bit. Rays start a hair above the surface along its geometric normal.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba

mi = mitsuba()

#: Distance of the ray's start from the surface, cm.
OFFSET = 2e-3

#: Cosine below the shading horizon down to which rays are traced, so that the bits still serve
#: after a normal has turned a little.
HORIZON = -0.3


def words(directions: int) -> int:
    """Number of 32-bit words that hold one bit per direction."""
    return (directions + 31) // 32


def trace(
    scene: Any,
    position: Any,
    normal: Any,
    geometric: Any,
    directions: Any,
    horizon: Any = HORIZON,
    free: Any = None,
) -> Any:
    """Visibility bits, mi.UInt32 of width words(D) * P: bit d % 32 of entry (d // 32) * P + p.

    scene: Mitsuba scene; position mi.Point3f, shading normal and geometric normal mi.Vector3f, all
    of width P; directions: mi.Vector3f of width D, unit, to the light. A direction whose cosine to
    the shading normal is below `horizon`, a number or mi.Float of width P, counts as not visible
    and costs no ray. free: mi.UInt32 of width D, 1 where nothing blocks a direction; None: nowhere.
    """
    # Opaque: a number baked into the kernel would have it compiled anew for every photo.
    points, count = (dr.opaque(mi.UInt32, dr.width(a)) for a in (position, directions))
    index = dr.arange(mi.UInt32, dr.width(position) * words(dr.width(directions)))
    point, first = index % points, (index // points) * 32
    n = dr.gather(mi.Vector3f, normal, point)
    start = dr.gather(mi.Point3f, position, point)
    start += OFFSET * dr.gather(mi.Vector3f, geometric, point)
    lowest = dr.gather(mi.Float, dr.full(mi.Float, 0, dr.width(position)) + horizon, point)
    bits, k = mi.UInt32(0), mi.UInt32(0)

    def body(k: Any, bits: Any, start: Any, n: Any, lowest: Any, first: Any) -> tuple[Any, ...]:
        d = first + k
        towards = dr.gather(mi.Vector3f, directions, d, d < count)
        active = (d < count) & (dr.dot(n, towards) > lowest)
        traced = active if free is None else active & (dr.gather(mi.UInt32, free, d, active) == 0)
        blocked = scene.ray_test(mi.Ray3f(start, towards), coherent=True, active=traced)
        bits |= dr.select(active & ~blocked, mi.UInt32(1) << k, 0)
        return k + 1, bits, start, n, lowest, first

    state = (k, bits, start, n, lowest, first)
    labels = ("k", "bits", "o", "n", "horizon", "d")
    bits = dr.while_loop(state, lambda k, *_: k < 32, body, labels=labels)[1]
    dr.eval(bits)
    return bits


def visible(bits: Any, points: Any, point: Any, direction: Any) -> Any:
    """Whether `direction` (UInt32 index) is seen from `point` (UInt32 index), as mi.Bool."""
    word = dr.gather(mi.UInt32, bits, (direction >> 5) * points + point)
    return ((word >> (direction & 31)) & 1) != 0


def unpacked(bits: Any, points: int, directions: int) -> np.ndarray:
    """(directions, points) uint8: 1 where a point sees the direction."""
    words = bits.numpy().reshape(-1, points).T.copy()
    return np.unpackbits(words.view(np.uint8), axis=1, count=directions, bitorder="little").T


def bits_at(bits: Any, points: int, index: Any) -> Any:
    """From the bits of `points` points, those of the points at `index` (mi.UInt32)."""
    count = dr.opaque(mi.UInt32, dr.width(index))
    own = dr.arange(mi.UInt32, dr.width(bits) // points * dr.width(index))
    point = dr.gather(mi.UInt32, index, own % count)
    return dr.gather(mi.UInt32, bits, own // count * dr.opaque(mi.UInt32, points) + point)
