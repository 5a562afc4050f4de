"""The eyes of a result: where their balls are, where they look, and how large the iris is.

The head model's eyeballs are spheres that look straight ahead; the photo's irises are somewhere on
them. Turned about its middle a sphere is the same surface, so that its texture can have the iris in
the middle of its chart, whatever the photo's eyes look at. The iris is where the landmarker sees
it, moved and resized by a few pixels to where the photo gets brighter across its rim (J. Daugman,
How iris recognition works, IEEE TCSVT 14(1), 2004), at the sides, which lids leave free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from ..color import luminance
from ..face.reconstruction import Reconstruction
from ..scene.components import components
from .parts import EYES, parts

#: The landmarker's points: the iris' middle, then four on its rim; the person's right and left.
_IRIS = ((468, 469, 470, 471, 472), (473, 474, 475, 476, 477))
#: An eye of which the photo shows less than this, of the other's, looks as the other does.
_LEAST = 0.25
#: Bounds on the angle between the eye's axis and the iris' rim, and on that of the gaze with the
#: head's front, radians; what an iris has that the photo does not show.
_RIM, _FARTHEST, _USUAL = (0.22, 0.42), 0.7, 0.33
#: Angles between both eyes' gazes from which the one that is seen less is wrong, radians.
_OUTWARDS, _HIGHER = 0.12, 0.12
#: The search for the rim: shifts and sizes, of the landmarks' radius, and how far inside and
#: outside of the rim brightness is compared. cos 45 degrees: how far from the level the rim is
#: looked at.
_SHIFTS, _SIZES = np.linspace(-0.3, 0.3, 9), np.linspace(0.8, 1.25, 10)
_WITHIN, _BEYOND, _LEVEL = 0.85, 1.15, 0.7
_AROUND = 48
#: What of the largest step a rim that is as far away as its radius, or e times as large, has to
#: have more.
_NEARER = 0.2
#: Samples that a rim has to have, of those _AROUND.
_SEEN = 8


@dataclass(frozen=True)
class Eye:
    """left: the person's. vertices: (V,) bool of the mesh. centre (3,), radius: cm, world frame.

    axis: (3,) unit, from the centre to the iris. rim: angle between axis and the iris' rim,
    radians.
    """

    left: bool
    vertices: np.ndarray
    centre: np.ndarray
    radius: float
    axis: np.ndarray
    rim: float


def eyes_of(r: Reconstruction) -> tuple[Eye, ...]:
    """Right and left eye of `r`; none of a mesh that was not fitted or has no two eyeballs."""
    motion = r.head.motion
    if motion is None:
        return ()
    mesh = r.face.mesh
    part = parts(mesh.vertices, mesh.triangles, mesh.triangle_uv)
    corners = np.unique(mesh.triangles[part == EYES])
    piece = components(mesh.triangles, len(mesh.vertices))
    balls = [piece == number for number in np.unique(piece[corners])]
    if len(balls) != 2:
        return ()
    across, front = motion.rotation[:, 0], motion.rotation[:, 2]
    balls.sort(key=lambda ball: float(mesh.vertices[ball].mean(axis=0) @ across))
    found = [_found(r, ball, front, bool(left)) for left, ball in enumerate(balls)]
    seen = np.array([eye[1] for eye in found])
    eyes = [eye[0] for eye in found]
    good = seen >= max(1.0, _LEAST * seen.max())
    if good.all() and _apart(motion.rotation, eyes):
        good[int(seen.argmin())] = False
    if not good.all() and good.any():
        lent = eyes[int(good.argmax())]
        both = zip(eyes, good, strict=True)
        eyes = [eye if ok else replace(eye, axis=lent.axis) for eye, ok in both]
    rims = [eye.rim for eye, ok in zip(eyes, good, strict=True) if ok]
    rim = float(np.mean(rims or [_USUAL]))
    return tuple(replace(eye, rim=rim) for eye in eyes)


def _apart(rotation: np.ndarray, eyes: list[Eye]) -> bool:
    """Whether two eyes, right and left, look at no one thing: outwards, or one higher."""
    right, left = (eye.axis @ rotation for eye in eyes)
    across = np.arctan2(left[0], left[2]) - np.arctan2(right[0], right[2])
    return bool(across > _OUTWARDS or abs(np.arcsin(left[1]) - np.arcsin(right[1])) > _HIGHER)


def looking(r: Reconstruction, eyes: tuple[Eye, ...]) -> Reconstruction:
    """`r` with its eyeballs turned: what the head model has in their front is at the iris."""
    if not eyes or r.head.motion is None:
        return r
    vertices = r.face.mesh.vertices.copy()
    for eye in eyes:
        turn = between(r.head.motion.rotation[:, 2], eye.axis)
        vertices[eye.vertices] = turned(vertices[eye.vertices], eye.centre, turn)
    return replace(r, face=replace(r.face, mesh=replace(r.face.mesh, vertices=vertices)))


def turned(points: np.ndarray, centre: np.ndarray, turn: Rotation) -> np.ndarray:
    """Points (N, 3), turned about `centre`."""
    return (turn.apply(points - centre) + centre).astype(np.float32)


def between(first: np.ndarray, second: np.ndarray) -> Rotation:
    """The least turn that brings one unit vector (3,) to another."""
    axis = np.cross(first, second)
    size = float(np.linalg.norm(axis))
    return Rotation.from_rotvec(axis * (np.arctan2(size, first @ second) / max(size, 1e-12)))


def _found(r: Reconstruction, ball: np.ndarray, front: np.ndarray, left: bool) -> tuple[Eye, float]:
    """The eye of the vertices `ball` (V,), and how many pixels of it the photo shows."""
    camera = r.face.camera
    points = r.face.mesh.vertices[ball].astype(np.float64)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).mean())
    plain = Eye(left, ball, centre, radius, front, _USUAL)
    size = radius * camera.focal / -centre[2]
    middle = camera.project(centre[None])[0]
    ys, xs = np.nonzero(r.photo.regions.eyes > 0.5)
    near = np.hypot(xs + 0.5 - middle[0], ys + 0.5 - middle[1]) < size
    if not near.any() or len(r.photo.landmarks) <= _IRIS[1][-1]:
        return plain, 0.0
    iris = r.photo.landmarks[list(_IRIS[left]), :2]
    wide = float(np.linalg.norm(iris[1:] - iris[0], axis=1).mean())
    if not 1 <= wide < size:
        return plain, float(near.sum())
    place, wide = _on_rim(r, iris[0], wide)
    ray = camera.unproject(place[None], 1.0)[0]
    ray /= np.linalg.norm(ray)
    along = float(ray @ centre)
    inside = radius**2 - (centre @ centre - along**2)
    axis = ray * (along - np.sqrt(max(inside, 0.0))) - centre
    axis /= np.linalg.norm(axis)
    off = between(front, axis).as_rotvec()
    angle = float(np.linalg.norm(off))
    if angle > _FARTHEST:
        axis = Rotation.from_rotvec(off * (_FARTHEST / angle)).apply(front)
    # The rim was looked at on the level, where an iris that is turned sideways looks narrow.
    wide /= np.sqrt(1 - min(axis[0] ** 2, 0.5))
    depth = -(centre + radius * axis)[2]
    rim = float(np.arcsin(np.clip(wide * depth / camera.focal / radius, 0, 0.9)))
    return replace(plain, axis=axis, rim=float(np.clip(rim, *_RIM))), float(near.sum())


def _on_rim(r: Reconstruction, middle: np.ndarray, size: float) -> tuple[np.ndarray, float]:
    """Middle (2,) and radius of the iris in the crop, pixels, from those of the landmarks."""
    bright = np.sqrt(luminance(np.maximum(r.photo.image, 0)))
    eye = (r.photo.regions.eyes > 0.5).astype(np.float32)
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = ring[np.abs(ring[:, 0]) > _LEVEL]
    dx, dy, scale = (grid.ravel() for grid in np.meshgrid(_SHIFTS, _SHIFTS, _SIZES, indexing="ij"))
    centres = middle + size * np.stack([dx, dy], axis=1)

    def at(image: np.ndarray, share: float) -> np.ndarray:
        place = centres[:, None] + ring * (size * scale * share)[:, None, None] - 0.5
        return ndimage.map_coordinates(image, [place[..., 1], place[..., 0]], order=1)

    free = (at(eye, _WITHIN) > 0.5) & (at(eye, _BEYOND) > 0.5)
    count = free.sum(axis=1)
    step = ((at(bright, _BEYOND) - at(bright, _WITHIN)) * free).sum(axis=1) / np.maximum(count, 1)
    # Of nearly equal steps the one nearest to the landmarks.
    away = np.hypot(dx, dy) + np.abs(np.log(scale))
    step = step * np.sqrt(count)
    step -= _NEARER * step.max() * away
    best = int(np.where(count >= _SEEN, step, -np.inf).argmax())
    if count[best] < _SEEN or step[best] <= 0:
        return middle, size
    return centres[best], float(size * scale[best])
