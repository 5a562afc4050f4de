"""Where the 478 landmarks lie on a head model: found by looking at pictures of it.

The neutral head is rendered from the front in plain colours, the landmarker is run on the
picture, and every point is cast back to the triangle it lies on. Several skins and framings are
averaged, because the landmarker's answer moves by a pixel or two with them, and so are the two
mirror halves. Points on the rims of the eyelids and of the lips would often miss the rim by a
hair and fall through the opening; they are moved onto it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..color import encode_srgb
from ..errors import ModelError
from ..machine.runtime import mitsuba
from ..perception.landmarks import find_faces
from ..perception.topology import LEFT_EYE, LIPS_INNER, RIGHT_EYE
from ..scene.camera import Camera
from ..scene.surface_points import SurfacePoints
from .eyebrows import eyebrow_vertices
from .model import VERTEX_REGIONS

# The inner rim of the lips: upper and lower points across the opening, without the corners.
_LIP_PAIRS = tuple(zip(LIPS_INNER[1:10], LIPS_INNER[:10:-1], strict=True))

_RESOLUTION = 640
_DISTANCE = 100.0
# Linear reflectance of skin for each picture, and the width of the view in cm.
_SKINS = ((0.62, 0.42, 0.34), (0.50, 0.31, 0.23), (0.34, 0.19, 0.13), (0.14, 0.075, 0.05))
_WIDTHS = (26.0, 30.0, 36.0)
_NUDGE = (7e-4, 3e-4)
_IRIS_RADIUS = 0.6
_PUPIL_RADIUS = 0.22


def embed_landmarks(
    vertices: np.ndarray, triangles: np.ndarray, region: np.ndarray, symmetric: bool
) -> SurfacePoints:
    """Find the landmarks on a frontal head in the model frame (model.py).

    region: (V,) index into VERTEX_REGIONS; lips and eyes are painted by it.
    symmetric: the mesh is its own mirror image, so the two halves are averaged.
    Raises ModelError when no face is seen.
    """
    head = _Head(vertices, triangles, region)
    # A face with eyebrows is easier to read, and only the first look says where they are.
    points = head.look(head.look(None))
    if symmetric:
        points = _symmetrised(points)
    for rim in (RIGHT_EYE, LEFT_EYE):
        _move_to_lid_rim(head, points, list(rim))
    _move_to_lip_rim(head, points)
    triangle, barycentric, _ = head.cast(points[:, :2])
    return SurfacePoints(triangle, barycentric)


class _Head:
    """A head as it looks, and as rays from the front hit it, along the z axis of the model frame.

    region: (V,) index into VERTEX_REGIONS.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, region: np.ndarray) -> None:
        mi = mitsuba()
        self._vertices, self._triangles, self._region = vertices, triangles, region
        #: (F,) bool: the triangles of the eyeballs, which show between the lids.
        self.eyeball = np.all((region == VERTEX_REGIONS.index("eyes"))[triangles], axis=1)
        mesh = mi.Mesh("head", len(vertices), len(triangles))
        self._fill(mesh, vertices)
        self._scene = mi.load_dict({"type": "scene", "head": mesh})

    def cast(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Triangle (N,) int32, barycentrics (N, 3) float32, hit points (N, 3) under `xy` (N, 2)."""
        mi = mitsuba()
        # Symmetric heads have a row of edges at x = 0, between whose triangles rays slip through.
        xy = np.asarray(xy, dtype=np.float32) + np.array(_NUDGE, dtype=np.float32)
        ray = mi.Ray3f(
            mi.Point3f(mi.Float(xy[:, 0]), mi.Float(xy[:, 1]), 100.0), mi.Vector3f(0, 0, -1)
        )
        hit = self._scene.ray_intersect_preliminary(ray, coherent=False)
        valid = np.asarray(hit.is_valid())
        triangle = np.where(valid, np.asarray(hit.prim_index).astype(np.int64), -1)
        u, v = (np.asarray(axis) for axis in (hit.prim_uv.x, hit.prim_uv.y))
        barycentric = np.where(valid[:, None], np.stack([1 - u - v, u, v], axis=-1), 0)
        points = np.einsum("lc,lcx->lx", barycentric, self._vertices[self._triangles[triangle]])
        points[~valid] = np.nan
        return triangle.astype(np.int32), barycentric.astype(np.float32), points

    def _fill(self, mesh: Any, vertices: np.ndarray) -> None:
        parameters = mitsuba().traverse(mesh)
        parameters["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
        parameters["faces"] = np.ascontiguousarray(self._triangles, np.uint32).ravel()
        parameters.update()

    def look(self, known: np.ndarray | None) -> np.ndarray:
        """Mean landmarks (478, 3), model frame, over the pictures; NaN where the rays miss.

        known: where they are about, for the eyebrows; None at first, for a head without.
        """
        seen = []
        for skin in _SKINS:
            colours = self._painted(np.array(skin), known)
            for width in _WIDTHS:
                picture, camera, offset = self._picture(colours, width)
                faces = find_faces(picture)
                if faces:
                    flat = camera.unproject(faces[0].landmarks[:, :2], _DISTANCE)
                    # The camera is far enough for parallel rays but for this small correction.
                    depth = self.cast((flat + offset)[:, :2])[2][:, 2]
                    near = np.where(np.isfinite(depth), _DISTANCE - (depth - offset[2]), _DISTANCE)
                    seen.append(
                        camera.unproject(faces[0].landmarks[:, :2], near)[:, :2] + offset[:2]
                    )
        if not seen:
            raise ModelError("no face is recognised in a picture of the neutral head of this model")
        return self.cast(np.mean(seen, axis=0))[2]

    def _painted(self, skin: np.ndarray, known: np.ndarray | None) -> np.ndarray:
        """Linear reflectance (V, 3)."""
        vertices, region = self._vertices, self._region
        code = {name: index for index, name in enumerate(VERTEX_REGIONS)}
        colours = np.tile(skin, (len(vertices), 1))
        colours[region == code["lips"]] = skin * (0.75, 0.45, 0.5)
        colours[region == code["mouth"]] = skin * (0.3, 0.1, 0.1)
        colours[region == code["teeth"]] = 0.6
        eyes = region == code["eyes"]
        colours[eyes] = 0.7
        for side in (vertices[:, 0] < 0, vertices[:, 0] > 0):
            ball = vertices[eyes & side]
            if len(ball):
                middle = ball[ball[:, 2].argmax(), :2]
                distance = np.linalg.norm(vertices[:, :2] - middle, axis=-1)
                colours[eyes & side & (distance < _IRIS_RADIUS)] = (0.09, 0.05, 0.03)
                colours[eyes & side & (distance < _PUPIL_RADIUS)] = 0.01
        if known is not None:
            colours[eyebrow_vertices(known, vertices)] = skin * 0.25
        return colours

    def _picture(self, colours: np.ndarray, width: float) -> tuple[np.ndarray, Camera, np.ndarray]:
        """sRGB picture (N, N, 3) uint8, its camera, the vector from there to the model's frame."""
        mi = mitsuba()
        half = _RESOLUTION / 2
        camera = Camera(_RESOLUTION, _RESOLUTION, _RESOLUTION * _DISTANCE / width, half, half)
        eyes_to_middle = -3.0  # the face's middle lies this far below the eyes
        offset = np.array([0.0, eyes_to_middle, 0.0])
        properties = mi.Properties()
        colour = {"type": "mesh_attribute", "name": "vertex_colour"}
        properties["bsdf"] = mi.load_dict(
            {"type": "twosided", "inner": {"type": "diffuse", "reflectance": colour}}
        )
        mesh = mi.Mesh(
            "head", len(colours), len(self._triangles), properties, has_vertex_normals=True
        )
        mesh.add_attribute("vertex_colour", 3, np.ascontiguousarray(colours, np.float32).ravel())
        self._fill(mesh, self._vertices - offset - (0, 0, _DISTANCE))
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 3},
                "sensor": camera.mitsuba_sensor(32),
                "head": mesh,
                "sky": {"type": "constant", "radiance": 0.7},
                "sun": {"type": "directional", "direction": [0, -0.4, -1], "irradiance": 1.0},
            }
        )
        linear = np.array(mi.render(scene, seed=0))[..., :3]
        encoded = np.clip(np.asarray(encode_srgb(linear)), 0, 1)
        return (encoded * 255 + 0.5).astype(np.uint8), camera, offset


def _symmetrised(points: np.ndarray) -> np.ndarray:
    """Average every landmark with the mirror image of its partner, found by assignment."""
    known = np.isfinite(points).all(axis=1)
    mirrored = points * (-1, 1, 1)
    cost = np.linalg.norm(points[known][:, None] - mirrored[known][None], axis=-1)
    result = points.copy()
    result[known] = (points[known] + mirrored[known][linear_sum_assignment(cost)[1]]) / 2
    # Upper and lower points of closed lips lie too close together for the assignment.
    for row in (LIPS_INNER[:11], LIPS_INNER[11:]):
        result[list(row)] = (points[list(row)] + mirrored[list(row[::-1])]) / 2
    return result


def _march(head: _Head, start: np.ndarray, step: np.ndarray, count: int) -> tuple[Any, Any]:
    """Points start + k step, k = 0..count, (count + 1, 2), and what the rays hit there."""
    path = start + np.arange(count + 1)[:, None] * step
    return path, head.cast(path)


def _move_to_lid_rim(head: _Head, points: np.ndarray, rim: list[int]) -> None:
    """Move the rim's points along the line from the middle of the eye to the first skin."""
    middle = np.nanmean(points[rim, :2], axis=0)
    for index in rim:
        arm = points[index, :2] - middle
        path, (triangle, _, hits) = _march(head, middle, 1.6 * arm / 320, 320)
        covered = np.flatnonzero((triangle >= 0) & ~head.eyeball[triangle])
        if head.eyeball[triangle[0]] and len(covered):
            points[index] = hits[covered[0]]
            points[index, :2] = path[covered[0]]


def _move_to_lip_rim(head: _Head, points: np.ndarray) -> None:
    """Move the inner lip points to the edges of the gap, if there is one, pairs and corners."""
    for upper, lower in _LIP_PAIRS:
        middle = (points[upper] + points[lower]) / 2
        reach, steps = 0.4, 400
        column = np.array([0.0, reach / steps])
        path, (_, _, hits) = _march(head, middle[:2] - (0, reach), column, 2 * steps)
        front = np.nanmax(hits[:, 2])
        inside = np.flatnonzero(hits[:, 2] < front - 1.0)
        if len(inside):
            points[lower], points[upper] = hits[inside[0] - 1], hits[inside[-1] + 1]
            points[lower, :2], points[upper, :2] = path[inside[0] - 1], path[inside[-1] + 1]
    middle = np.mean([points[list(pair), :2].mean(axis=0) for pair in _LIP_PAIRS], axis=0)
    for corner in (LIPS_INNER[0], LIPS_INNER[10]):
        path, (_, _, hits) = _march(head, middle, 1.3 * (points[corner, :2] - middle) / 400, 400)
        front = np.nanmax(hits[:, 2])
        inside = np.flatnonzero(hits[:, 2] < front - 2.0)
        if len(inside) and inside[-1] < 400:
            points[corner] = hits[inside[-1] + 1]
            points[corner, :2] = path[inside[-1] + 1]
