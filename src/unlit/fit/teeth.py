"""Rows of teeth where the photo shows them.

No landmark tells of teeth. The head model hangs the upper row on the skull and the lower one on the
jaw, but lips alone do not say how much of a smile is the jaw's opening and how much lips that are
drawn back: fitted to smiles with closed teeth, upper lips cover the upper row wholly, and the
tongue stands in the opening. So an open mouth's rows are moved up or down until their edges are
where the photo's pale pixels end, and forwards until they are as near to the lips as teeth are.
Each row moves as a whole; what would then stand in a lip goes back behind it. The ends of a row may
stand deep in the cheeks, where nobody sees them.

The fit itself is one of the head without them: on its way lips may lie behind the teeth, which
would hide skin that the photo shows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..head.contact import pieces
from ..head.model import VERTEX_REGIONS, HeadModel
from ..machine.runtime import mitsuba
from ..perception.topology import LIPS_INNER
from ..scene.arrays import device
from ..scene.camera import Camera
from ..scene.mesh import Mesh
from .state import State

mi = mitsuba()

# Centimetres. How far a row goes past the edge that is seen: else the shade beyond it is seen, too.
# Half the width of the middle of a row, by which it is placed; the width of the columns in it; the
# least gap between the rows that is seen in one; how far a row may go up or down, and forwards or
# back; and what is left between teeth and lips.
_PAST = 0.2
_MIDDLE, _COLUMN, _GAP = 1.5, 0.15, 0.25
_FARTHEST_DOWN, _FARTHEST_UP, _FARTHEST_ALONG = 2.0, 0.5, 0.8
_CLEARANCE = 0.1
_LEANINGS = np.linspace(-0.6, 0.6, 13)  # cm a cm of height
# Share of the columns that have to show teeth, or a lower row; the percentage of a row's points
# that may meet the lips first, to be moved alone.
_SEEN, _FIRST = 0.5, 10.0


def without_teeth(model: HeadModel) -> HeadModel:
    """The model without the triangles of what stands in its mouth and hangs on nothing.

    The vertices stay, and move with the coefficients.
    """
    piece = pieces(model)
    names = ("teeth", "mouth")
    mouth = np.isin(model.vertex_region, [VERTEX_REGIONS.index(name) for name in names])
    apart = mouth & (piece != np.bincount(piece).argmax())
    kept = ~apart[model.triangles].all(axis=1)
    points = model.landmark_points
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    carriers = np.where(points.triangle >= 0, number[points.triangle], -1).astype(np.int32)
    return replace(
        model,
        triangles=model.triangles[kept],
        triangle_uv=model.triangle_uv[kept],
        landmark_points=replace(points, triangle=carriers),
    )


def teeth_placed(
    model: HeadModel, vertices: np.ndarray, state: State, camera: Camera, teeth: np.ndarray
) -> np.ndarray:
    """`vertices` (V, 3) float32 with the rows of teeth where the photo has them, all else the same.

    vertices: world frame, cm, of the head at `state`. teeth: (S, S) bool, the pixels of `camera`
    that show teeth; without any the rows stay, behind the lips. A model without teeth is left as it
    is.
    """
    piece = pieces(model)
    of_teeth = model.vertex_region == VERTEX_REGIONS.index("teeth")
    rows = [piece == number for number in np.unique(piece[of_teeth])]
    if len(rows) != 2:
        return vertices
    shape = (vertices - state.translation) @ state.rotation  # in the model frame
    upper, lower = sorted(rows, key=lambda row: -float(shape[row, 1].mean()))
    moved = vertices.copy()
    skin = model.triangles[piece[model.triangles[:, 0]] == np.bincount(piece).argmax()]
    flesh = Mesh(shape.astype(np.float32), skin)
    # Nothing holds back what stands in the opening: the lips' rims do.
    rims = model.landmarks(shape)[[LIPS_INNER[5], LIPS_INNER[15]], 2]
    limit = float(np.nanmax(rims)) - _CLEARANCE if np.isfinite(rims).any() else np.inf
    edges = _edges(_on_plane(teeth, state, camera, shape[upper, 2].max()))
    ends = (np.min, np.max)
    for row, edge, end in zip((upper, lower), edges, ends, strict=True):
        points = shape[row]
        if edge is not None:
            middle = np.abs(points[:, 0]) < _MIDDLE
            past = _PAST if row is lower else -_PAST
            rise = edge + past - end(points[middle, 1])
            points[:, 1] += np.clip(rise, -_FARTHEST_DOWN, _FARTHEST_UP)
            points = _against_lips(flesh, points, middle, limit)
        room = _room(flesh, points)
        points[:, 2] += np.where(room > -_FARTHEST_ALONG, np.minimum(room, 0), 0)
        moved[row] = state.placed(points)
    return moved


def _against_lips(flesh: Mesh, points: np.ndarray, middle: np.ndarray, limit: float) -> np.ndarray:
    """`points` (N, 3) of a row, moved forwards and leant until its `middle` (N,) is at the lips.

    Of the leanings, shears along z, the one that brings the row farthest forwards. limit: z, cm,
    that the row's front stays behind.
    """
    front = middle & (points[:, 2] > points[:, 2].max() - _MIDDLE)
    height = points[:, 1] - points[front, 1].mean()
    found, farthest = points, -np.inf
    for lean in _LEANINGS:
        leant = points + (lean * height)[:, None] * (0, 0, 1)
        room = _room(flesh, leant)[front]
        room = room[np.isfinite(room) & (room > -_FARTHEST_ALONG)]
        if len(room):
            along = min(float(np.percentile(room, _FIRST)), limit - leant[front, 2].max())
            along = np.clip(along, -_FARTHEST_ALONG, _FARTHEST_ALONG)
            if along > farthest:
                found, farthest = leant + along * np.array([0, 0, 1]), along
    return found


def _on_plane(teeth: np.ndarray, state: State, camera: Camera, depth: float) -> np.ndarray:
    """Points (N, 2), model frame, where the rays of the pixels `teeth` meet the plane z = depth."""
    ys, xs = np.nonzero(teeth)
    ray = camera.unproject(np.stack([xs, ys], axis=1) + 0.5, 1.0) @ state.rotation
    eye = -state.translation @ state.rotation
    length = (depth - eye[2]) / np.minimum(ray[:, 2:], -1e-6)
    return np.asarray((eye + length * ray)[:, :2])


def _edges(points: np.ndarray) -> tuple[float | None, float | None]:
    """Heights, cm, at which the upper row ends and the lower one begins; None: not seen.

    points: (N, 2), those that show teeth. Where no gap parts the rows, all is the upper one's.
    """
    ends, begins = [], []
    columns = np.floor(points[:, 0] / _COLUMN)
    wanted = round(2 * _MIDDLE / _COLUMN)
    for column in np.arange(-wanted // 2, wanted // 2):
        heights = np.sort(points[columns == column, 1])[::-1]
        if not len(heights):
            continue
        gaps = np.flatnonzero(-np.diff(heights) > _GAP)
        ends.append(heights[gaps[0]] if len(gaps) else heights[-1])
        if len(gaps):
            begins.append(heights[gaps[-1] + 1])
    # A row is bent: its middle lies lower than the rest of it, and is where the row is measured.
    upper, lower = (
        float(np.percentile(found, share)) if len(found) >= _SEEN * wanted else None
        for found, share in ((ends, 20), (begins, 50))
    )
    return upper, lower


def _room(flesh: Mesh, points: np.ndarray) -> np.ndarray:
    """How far each of points (N, 3) may go forwards (+z) until it is behind the lips, (N,) cm.

    Less than 0 within them; infinite in the opening, where nothing is in front.
    """

    def hits(direction: int) -> tuple[np.ndarray, np.ndarray]:
        towards = mi.Vector3f(0, 0, direction)
        found = flesh.scene.ray_intersect(mi.Ray3f(device(mi.Point3f, points), towards))
        distance = np.where(found.is_valid().numpy(), found.t.numpy(), np.inf)
        return distance, found.n.numpy()[2] * direction > 0

    ahead, leaves = hits(1)
    behind, _ = hits(-1)
    # A surface that is met from its back: the point lies in the flesh.
    return np.where(leaves & np.isfinite(ahead), -behind, ahead) - _CLEARANCE
