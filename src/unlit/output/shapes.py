"""The head's expression units on the person's own mesh: the morph targets of face.glb.

A unit is added to the fitted mesh as the head model adds it, in the head's own frame. What a linear
model knows nothing of is put right for the person: a blink is scaled until this person's lids meet,
wherever the photo left them, and lids stay in front of the eyeball and its cornea, also half-way,
since a viewer moves along straight lines. Where a unit turns an eye, the eyeball is turned.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import OutputError
from ..face.head import Motion
from ..face.reconstruction import Reconstruction
from ..head.contact import seal_lips, shut_lids
from ..perception.topology import LEFT_LID_GAP, RIGHT_LID_GAP
from .cornea import bulge
from .eyes import Eye, between, turned

#: How far the face units turn MakeHuman's eyeball helpers, degrees: about the head's axis x
#: (downwards) or y (to the person's left).
_GAZE = {"Up": -11.5, "Down": 17.0, "In": 24.0, "Out": 23.0}
#: A blink is not stretched more than this: lids that the photo has wide open stay a little open.
_WIDEST = 1.6
_TIMES = 3
#: What is left between lids and eye, cm; how near to an eyeball something counts as its lid, in
#: radii; and how far a target may go out so that the way to it stays clear, cm.
_CLEARANCE, _NEAR, _FARTHEST = 0.012, 1.35, 0.12


def neutral(r: Reconstruction, eyes: tuple[Eye, ...]) -> tuple[Reconstruction, tuple[Eye, ...]]:
    """`r` without the photo's expression and pose, and its eyes, which look straight ahead.

    The mesh is in the head model's frame: upright, the face along +z, cm; eyeballs as `looking`
    turns them. Raises OutputError for a result without a fitted head, or saved before it was kept.
    """
    motion = r.head.motion
    if motion is None:
        raise OutputError(
            "the result does not say how its head is posed (a mesh that was not fitted, or saved "
            "by an older unlit): reconstruct the photo again, or export with --pose photo"
        )
    mesh = r.face.mesh
    local = _local(motion, mesh.vertices)
    moved = local.copy()
    for number in np.flatnonzero(motion.expression):
        moved -= motion.expression[number] * motion.of(int(number), len(local))
    landmarks = r.head.landmark_points.on(moved, mesh.triangles)
    if len(landmarks) > max(map(max, (*LEFT_LID_GAP, *RIGHT_LID_GAP))):
        moved = seal_lips(landmarks, moved)
    front = np.array([0.0, 0.0, 1.0])
    straight = tuple(
        replace(eye, centre=_local(motion, eye.centre[None])[0], axis=front) for eye in eyes
    )
    for eye, ahead in zip(eyes, straight, strict=True):
        turn = between(eye.axis @ motion.rotation, front)
        moved[eye.vertices] = turned(local[eye.vertices], ahead.centre, turn)
    still = replace(
        motion,
        expression=np.zeros_like(motion.expression),
        rotation=np.eye(3),
        translation=np.zeros(3),
    )
    out = replace(
        r,
        head=replace(r.head, motion=still),
        face=replace(r.face, mesh=replace(mesh, vertices=moved.astype(np.float32))),
    )
    return out, straight


def lids_clear(r: Reconstruction, eyes: tuple[Eye, ...]) -> Reconstruction:
    """`r` with lids in front of the corneas, which stand out of the eyeballs that were fitted."""
    if not eyes:
        return r
    vertices = r.face.mesh.vertices.astype(np.float64)
    for eye in eyes:
        vertices = _clear(vertices, vertices, eye, eye.axis, still=True)
    mesh = replace(r.face.mesh, vertices=vertices.astype(np.float32))
    return replace(r, face=replace(r.face, mesh=mesh))


def shapes(r: Reconstruction, eyes: tuple[Eye, ...]) -> dict[str, np.ndarray]:
    """By unit's name, how it moves the mesh at full strength: (V, 3) float32, cm, r's frame.

    r: eyeballs as `looking` turns them. Empty for a head that was not fitted.
    """
    motion = r.head.motion
    if motion is None:
        return {}
    local = _local(motion, r.face.mesh.vertices)
    landmarks = r.head.landmark_points.on(local, r.face.mesh.triangles)
    balls = tuple(
        replace(
            eye,
            centre=_local(motion, eye.centre[None])[0],
            axis=eye.axis @ motion.rotation,
        )
        for eye in eyes
    )
    out = {}
    for number, name in enumerate(motion.names):
        delta = motion.of(number, len(local)).astype(np.float64)
        goal = local + delta
        left = name.endswith("Left")
        blinks = name.startswith("eyeBlink") and len(landmarks) > max(map(max, LEFT_LID_GAP))
        if blinks:
            goal = local + delta * _closing(landmarks, r, delta, left)
        # Shut lids that are put in front of the eye may part again.
        for _ in range(_TIMES if blinks else 1):
            if blinks:
                there = r.head.landmark_points.on(goal, r.face.mesh.triangles)
                goal = shut_lids(there, goal, left)
            for eye in balls:
                turn = _gaze(name, eye)
                goal[eye.vertices] = turned(local[eye.vertices], eye.centre, turn)
                goal = _clear(local, goal, eye, turn.apply(eye.axis))
        out[name] = ((goal - local) @ motion.rotation.T).astype(np.float32)
    return out


def _local(motion: Motion, points: np.ndarray) -> np.ndarray:
    """Points (N, 3) of the world in the head model's frame, float64."""
    return np.asarray((points.astype(np.float64) - motion.translation) @ motion.rotation)


def _gaze(name: str, eye: Eye) -> Rotation:
    """How the unit `name` turns the eye, in the head's frame."""
    side = "Left" if eye.left else "Right"
    way = name.removeprefix("eyeLook").removesuffix(side)
    if name != f"eyeLook{way}{side}" or way not in _GAZE:
        return Rotation.identity()
    if way in ("Up", "Down"):
        return Rotation.from_euler("x", _GAZE[way], degrees=True)
    outwards = (way == "Out") == eye.left
    return Rotation.from_euler("y", _GAZE[way] if outwards else -_GAZE[way], degrees=True)


def _closing(landmarks: np.ndarray, r: Reconstruction, delta: np.ndarray, left: bool) -> float:
    """Factor on a blink (V, 3) at which the lids of `landmarks` (478, 3) meet."""
    upper, lower = (
        list(rim) for rim in zip(*(LEFT_LID_GAP if left else RIGHT_LID_GAP), strict=True)
    )
    moves = r.head.landmark_points.on(delta, r.face.mesh.triangles)[:, 1]
    opened = float(np.mean(landmarks[upper, 1] - landmarks[lower, 1]))
    closing = float(np.mean(moves[lower] - moves[upper]))
    if not (np.isfinite(opened) and closing > 1e-3):
        return 1.0
    return float(np.clip(opened / closing, 0, _WIDEST))


def _clear(
    start: np.ndarray, goal: np.ndarray, eye: Eye, axis: np.ndarray, still: bool = False
) -> np.ndarray:
    """`goal` (V, 3) with what is in the eye moved out of it, and so that the way there is clear.

    start: (V, 3), where the way begins. axis: (3,) of the eye when it is at the goal. Only what
    moves along the way is touched, or where all is `still`, whatever is in the eye.
    """
    near = ~eye.vertices & (np.linalg.norm(goal - eye.centre, axis=1) < _NEAR * eye.radius)
    if not still:
        near &= np.abs(goal - start).max(axis=1) > 1e-5
    rows = np.flatnonzero(near)
    out = goal.copy()
    begin = start[rows] - eye.centre
    # Inside at the start, as what lines the socket may be: no way there can be clear.
    low = np.minimum(np.linalg.norm(begin, axis=1) - eye.radius, _CLEARANCE)

    def lacking(arm: np.ndarray, along: float) -> np.ndarray:
        distance = np.linalg.norm(arm, axis=1)
        turn = between(eye.axis, axis).as_rotvec() * along
        front = Rotation.from_rotvec(turn).apply(eye.axis)
        angle = np.arccos(np.clip(arm @ front / np.maximum(distance, 1e-9), -1, 1))
        least = eye.radius + np.where(low < 0, low, _CLEARANCE + bulge(eye, angle))
        return np.maximum(least - distance, 0)

    arm = out[rows] - eye.centre
    unit = arm / np.maximum(np.linalg.norm(arm, axis=1, keepdims=True), 1e-9)
    arm += lacking(arm, 1.0)[:, None] * unit
    half = lacking((begin + arm) / 2, 0.5)
    arm += np.minimum(2 * half, _FARTHEST)[:, None] * unit
    out[rows] = eye.centre + arm
    return out
