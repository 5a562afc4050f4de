"""Texture layouts: where in the atlas each part of the head lies.

"head" is the head model's own layout, made for painting a whole head: the face has a tenth of it.
"face" gives most of the square to the face, which is what a photo measures:

- The chart with the face keeps its shape and its seams; u and v are each stretched by a smooth
  growing function, evenly across the face, then less and less towards the chart's edges. What
  mirrors itself about a line of constant u still does.
- All other charts (eyes, mouth, eye sockets) are set side by side below it.

Both depend on the head model alone, not on the photo.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..face.face import PosedMesh
from ..face.head import FittedHead
from ..face.reconstruction import Reconstruction
from ..perception.topology import FACE_OVAL
from ..scene.components import components
from .parts import EYES, INSIDE, SKIN, mirror_axis, parts

LAYOUTS = ("face", "head")
#: Texels a side.
SMALLEST, LARGEST = 512, 4096

#: Of the square: its empty border, the gap between charts, the height of the row of small charts.
_BORDER, _GAP, _ROW = 0.005, 0.01, 0.16
#: Part of the chart's width and height that the face takes.
_FACE = (0.82, 0.84)
#: Of the face's height: what of the forehead lies above the landmarks.
_FOREHEAD = 0.08
#: How much larger the middle of an eyeball's chart gets, where the iris is.
_FRONT = 3.0
#: Charts that nobody sees may be squeezed sideways to this part.
_NARROWEST = 0.3


def laid_out(reconstruction: Reconstruction, layout: str) -> Reconstruction:
    """`reconstruction` with the texture coordinates of `layout`, one of LAYOUTS.

    The head's own where the head model has no landmarks of the face's outline on one chart.
    """
    r = reconstruction
    if layout == "head":
        return r
    uv = _face_first(r.head, r.face.mesh)
    return replace(r, face=replace(r.face, mesh=replace(r.face.mesh, uv=uv)))


def atlas_size(reconstruction: Reconstruction) -> int:
    """Texels a side that the crop is worth: twice its pixels, as a power of two.

    In the layout "face" nearly all of the face's pixels then have a texel of their own.
    """
    wanted = 2 ** int(np.ceil(np.log2(2 * len(reconstruction.photo.image))))
    return int(np.clip(wanted, SMALLEST, LARGEST))


def _face_first(head: FittedHead, mesh: PosedMesh) -> np.ndarray:
    points = head.landmark_points
    oval = np.asarray(FACE_OVAL)
    if oval.max() >= len(points.triangle) or (points.triangle[oval] < 0).any():
        return mesh.uv
    corners = mesh.triangle_uv[points.triangle[oval]]
    face = (mesh.uv[corners] * points.barycentric[oval][..., None]).sum(axis=1)
    chart = components(mesh.triangle_uv, len(mesh.uv))
    main = chart == chart[corners[0, 0]]
    if not main[corners].all():
        return mesh.uv
    low, high = face.min(axis=0), face.max(axis=0)
    high[1] += _FOREHEAD * (high[1] - low[1])
    axis = mirror_axis(mesh.uv, mesh.triangle_uv[main[mesh.triangle_uv[:, 0]]])
    if axis is not None:
        half = max(axis - low[0], high[0] - axis)
        low[0], high[0] = axis - half, axis + half
    out = mesh.uv.astype(np.float64)
    others = _others(mesh, chart, main)
    floor = _BORDER + (_ROW + _GAP if others else 0)
    for side, bottom in ((0, _BORDER), (1, floor)):
        stretched = _stretched(out[main, side], low[side], high[side], _FACE[side])
        out[main, side] = bottom + (1 - _BORDER - bottom) * stretched
    _place(out, others)
    return out.astype(np.float32)


def _stretched(values: np.ndarray, low: float, high: float, share: float) -> np.ndarray:
    """`values` (N,) mapped onto [0, 1]: [low, high], stretched evenly, takes `share` of it.

    On both sides the stretch falls off smoothly from that of the middle; the rest of the room is
    theirs, in proportion to their lengths.
    """
    first, last = values.min(), values.max()
    low, high = max(low, first), min(high, last)
    before, after = low - first, last - high
    rest = 1 - share
    room = rest * before / max(before + after, 1e-9)
    pace = share / max(high - low, 1e-9)

    def beyond(distance: np.ndarray, length: float, width: float) -> np.ndarray:
        t = np.clip(distance / max(length, 1e-9), 0, 1)
        steep = max(pace * length / max(width, 1e-9), 1)
        return width * steep * t / (1 + (steep - 1) * t)

    return (
        room
        - beyond(low - values, before, room)
        + pace * (np.clip(values, low, high) - low)
        + beyond(values - high, after, rest - room)
    )


@dataclass(frozen=True)
class _Chart:
    """vertices: (V,) bool. kind: one of parts.py."""

    vertices: np.ndarray
    kind: int


def _fronted(disc: np.ndarray) -> np.ndarray:
    """Points (N, 2) of a disc about 0, its middle stretched _FRONT times and its rim kept."""
    radius = np.minimum(np.linalg.norm(disc, axis=1, keepdims=True), 1)
    return disc * (1 + (_FRONT - 1) * (1 - radius) ** 2)


def _others(mesh: PosedMesh, chart: np.ndarray, main: np.ndarray) -> list[_Chart]:
    """All charts but `main`, skin first and what is inside last."""
    part = parts(mesh.vertices, mesh.triangles, mesh.triangle_uv)
    of_triangle = chart[mesh.triangle_uv[:, 0]]
    found = []
    for number in np.unique(of_triangle):
        vertices = chart == number
        if not main[vertices].any():
            kind = int(np.bincount(part[of_triangle == number]).argmax())
            found.append(_Chart(vertices, kind))
    return sorted(found, key=lambda chart: (chart.kind != SKIN, chart.kind))


def _place(out: np.ndarray, charts: list[_Chart]) -> None:
    """Set `charts` side by side in the row at the bottom of `out` (T, 2), in place."""
    if not charts:
        return
    size = np.array([np.ptp(out[chart.vertices], axis=0) for chart in charts])
    scale = _ROW / np.maximum(size[:, 1], 1e-9)
    kind = np.array([chart.kind for chart in charts])
    size *= np.where(kind == EYES, scale, np.minimum(scale, 1))[:, None]  # photos show eyes
    gap = min(_GAP, 0.2 / len(charts))
    room = 1 - 2 * _BORDER - gap * (len(charts) - 1)
    hidden = kind == INSIDE
    seen, unseen = size[~hidden, 0].sum(), size[hidden, 0].sum()
    squeeze = np.clip((room - seen) / max(unseen, 1e-9), _NARROWEST, 1)
    size[hidden, 0] *= squeeze
    size[:, 0] *= min(1, room / size[:, 0].sum())
    left = _BORDER
    for chart, (width, height) in zip(charts, size, strict=True):
        points = out[chart.vertices]
        low = points.min(axis=0)
        share = (points - low) / np.maximum(np.ptp(points, axis=0), 1e-9)
        if chart.kind == EYES:
            share = 0.5 + 0.5 * _fronted(2 * share - 1)
        out[chart.vertices] = (left, _BORDER) + share * (width, height)
        left += width + gap
