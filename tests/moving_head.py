"""The default head model as a result: posed, with an expression, and eyes that the photo shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from changed import changed
from small_head import small_head
from unlit.face.reconstruction import Reconstruction
from unlit.fit.head import motion
from unlit.fit.state import State
from unlit.head.contact import eyeballs
from unlit.head.model import HeadModel
from unlit.perception.regions import Regions
from unlit.scene.mesh import Mesh

IRIS = 0.3  # angle of the iris' rim, radians
GAZE = np.array([0.25, 0.1, 1.0]) / np.linalg.norm([0.25, 0.1, 1.0])


def moving_head(head: HeadModel, expression: dict[str, float], size: int = 96) -> Reconstruction:
    """`head`, turned and tilted, with units of the strengths `expression`; it looks along GAZE,
    model frame. Its maps are the small head's but for the eyes: an iris of .02 on a white of .6."""
    amounts = np.array([expression.get(name, 0.0) for name in head.expression_names])
    rotation = Rotation.from_euler("yx", [20, 8], degrees=True).as_matrix()
    state = State(rotation, np.array([0.5, 1.0, -80.0]), np.zeros(len(head.identity)), amounts)
    vertices = state.placed(head.vertices(state.identity, amounts)).astype(np.float32)
    r = small_head(size)
    mesh = replace(
        r.face.mesh,
        vertices=vertices,
        triangles=head.triangles,
        uv=head.uv,
        triangle_uv=head.triangle_uv,
    )
    camera = r.face.camera
    hits = Mesh(vertices, head.triangles).camera_hits(camera)
    triangle = np.full(size * size, -1)
    triangle[hits.pixel.numpy()] = hits.triangle.numpy()
    eye = np.zeros((size, size), bool)
    colour = np.full((size, size, 3), 0.3, np.float32)
    landmarks = np.full((478, 3), -1.0)
    axis = rotation @ GAZE
    side = np.cross(axis, (0, 1, 0)) / np.linalg.norm(np.cross(axis, (0, 1, 0)))
    rays = camera.directions()
    for ball, first in zip(eyeballs(head), (468, 473), strict=True):
        points = vertices[ball].astype(float)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = np.linalg.norm(points - centre, axis=1).mean()
        along = rays @ centre
        inside = radius**2 - (centre @ centre - along**2)
        hit = rays * (along - np.sqrt(np.maximum(inside, 0)))[..., None] - centre
        angle = np.arccos(np.clip(hit @ axis / radius, -1, 1))
        here = ball[head.triangles[triangle.reshape(size, size), 0]] & (inside > 0)
        here &= (triangle >= 0).reshape(size, size)
        eye |= here
        colour[here] = np.where(angle[here] < IRIS, 0.02, 0.6)[:, None]
        rim = [
            axis * np.cos(IRIS) + np.sin(IRIS) * way
            for way in (side, np.cross(side, axis), -side, -np.cross(side, axis))
        ]
        places = centre + radius * np.array([axis, *rim])
        landmarks[first : first + 5, :2] = camera.project(places)
    weights = np.zeros((size, size, 6), np.float32)
    weights[..., 2] = eye
    weights[..., 0] = ~eye
    mask = (triangle >= 0).reshape(size, size).astype(np.float32)
    return changed(
        r,
        {
            "face.mesh": mesh,
            "face.mask": mask,
            "face.maps.diffuse_albedo": colour,
            "head.mesh": mesh,
            "head.landmark_points": head.landmark_points,
            "head.motion": motion(head, state),
            "photo.regions": Regions(weights),
            "photo.landmarks": landmarks,
            "photo.image": colour,
        },
    )
