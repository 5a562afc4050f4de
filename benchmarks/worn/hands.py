"""A hand that touches the face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from heads import Head
from scipy.spatial import KDTree
from skimage.measure import marching_cubes

from .pieces import Piece, cloth_colour, matte, piece_of, rgb_of, tube_mesh, two_sided, wave_field

Bone = tuple[np.ndarray, np.ndarray, float, float]  # two ends (3,) cm, and the radius at each


def _finger(
    base: np.ndarray, lengths: tuple[float, ...], radius: float, bend: Any, spread: float
) -> list[Bone]:
    """Bones of a finger from its knuckle; bend: rad at each joint, towards the palm (-z)."""
    bones, flex = [], 0.0
    for i, (length, turn) in enumerate(zip(lengths, bend, strict=True)):
        flex += turn
        step = np.array([np.sin(spread) * np.cos(flex), np.cos(flex), -np.sin(flex)])
        end = base + step * length / np.linalg.norm(step)
        bones.append((base, end, radius * (1 - 0.1 * i), radius * (0.9 - 0.1 * i)))
        base = end
    return bones


def _bones(rng: np.random.Generator, pose: str) -> tuple[list[Bone], list[list[Bone]], np.ndarray]:
    """Palm and forearm, fingers (index first, thumb last), and the forearm's direction.

    In the hand's frame: the wrist at 0, fingers along +y, the palm faces -z, the thumb at +x.
    """
    knuckles = np.array([[2.7, 9.0, 0], [0.9, 9.3, 0.25], [-0.95, 8.9, 0.15], [-2.7, 8.0, -0.2]])
    lengths = [(4.3, 2.6, 2.1), (4.8, 3.0, 2.2), (4.4, 2.8, 2.2), (3.5, 2.1, 1.9)]
    if pose == "fist":
        bends = [np.array([1.2, 1.5, 0.8]) + rng.normal(0, 0.1, 3) for _ in range(4)]
    elif pose == "point":
        bends = [np.array([0.15, 0.2, 0.15])]
        bends += [np.array([1.1, 1.5, 0.8]) + rng.normal(0, 0.1, 3) for _ in range(3)]
    else:
        curl = rng.uniform(0.15, 0.35) if pose == "flat" else rng.uniform(0.4, 0.6)
        bends = [curl * rng.uniform(0.7, 1.3, 3) for _ in range(4)]
    fan = rng.uniform(0.0, 0.13) if pose in ("flat", "cup") else 0.02
    fingers = [
        _finger(k, le, r, b, fan * s)
        for k, le, r, b, s in zip(
            knuckles, lengths, (0.92, 0.95, 0.9, 0.78), bends, (1.3, 0.4, -0.5, -1.6), strict=True
        )
    ]
    root, joint = np.array([2.3, 2.0, -0.6]), np.array([4.2, 5.0, -1.6])
    if pose in ("fist", "point"):
        ways = ([-0.15, 0.75, -0.65], [-0.8, 0.5, -0.3])
    else:
        ways = ([rng.uniform(0.2, 0.7), 0.8, -0.35], [rng.uniform(0.0, 0.4), 0.9, -0.3])
    thumb = [(root, joint, 1.35, 1.05)]
    for way, length, radius in zip(ways, (3.3, 2.7), (0.98, 0.88), strict=True):
        start = thumb[-1][1]
        end = start + length * np.array(way) / np.linalg.norm(way)
        thumb.append((start, end, radius, radius * 0.88))
    palm = [(np.array([0.45 * k[0], 1.0, -0.1]), k, 1.25, 1.0) for k in knuckles]
    palm.append((np.array([-1.7, 1.5, -0.6]), np.array([-2.4, 6.0, -0.6]), 1.2, 1.0))
    bow, lean = rng.normal(0, 0.3), rng.normal(0, 0.2)
    arm = np.array([np.sin(lean), -np.cos(lean) * np.cos(bow), np.sin(bow)])
    for x in (-0.95, 0.95):
        start = np.array([x, 0, 0])
        palm.append((start, start + 22 * arm + [0.5 * x, 0, 0], 1.75, 3.0))
        palm.append((start, np.array([x, 2.0, -0.1]), 1.75, 1.4))
    return palm, [*fingers, thumb], arm


def _join_smooth(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Minimum of two distance fields with a rounded seam of `width` cm."""
    near = np.maximum(width - np.abs(a - b), 0) / width
    return np.minimum(a, b) - near**2 * width / 4


def _field(bones: list[Bone], low: np.ndarray, shape: Any, step: float, seam: float) -> np.ndarray:
    """Distance (cm) to bones on a grid of spacing `step` from `low`; correct near them only."""
    field = np.full(shape, 3.0)
    for a, b, ra, rb in bones:
        pad = max(ra, rb) + seam + 2 * step
        first = np.maximum(((np.minimum(a, b) - pad - low) / step).astype(int), 0)
        last = np.minimum(((np.maximum(a, b) + pad - low) / step).astype(int) + 2, shape)
        box = tuple(slice(f, e) for f, e in zip(first, last, strict=True))
        if any(s.stop <= s.start for s in box):
            continue
        axes = [low[i] + step * np.arange(box[i].start, box[i].stop) for i in range(3)]
        offset = [axis - a[i] for i, axis in enumerate(np.ix_(*axes))]
        bone = b - a
        dot = sum(o * w for o, w in zip(offset, bone, strict=True))
        t = np.clip(dot / (bone @ bone), 0, 1)
        square = sum((o - w * t) ** 2 for o, w in zip(offset, bone, strict=True))
        field[box] = _join_smooth(field[box], np.sqrt(square) - (ra + (rb - ra) * t), seam)
    return field


def _surface(field: np.ndarray, low: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of the zero level of a field."""
    vertices, triangles, _, _ = marching_cubes(field, 0.0, spacing=(step,) * 3)
    return low + vertices, triangles


@dataclass(frozen=True)
class _Touch:
    """How a hand meets the head: pose, what point of the head, from where.

    target (3,); normal: where the back of the hand looks; fingers: where they point; along: the
    direction in which the hand backs off until it only touches; anchor (3,) in the hand's frame.
    """

    pose: str
    target: np.ndarray
    normal: np.ndarray
    fingers: np.ndarray
    along: np.ndarray
    anchor: np.ndarray


def _touch(head: Head, rng: np.random.Generator, side: int) -> _Touch:
    """Choose a place and a pose; side +1 is the subject's left."""

    def mark(right: int, left: int) -> np.ndarray:
        return head.point(left if side > 0 else right)

    kind = str(
        rng.choice(
            ["cheek", "chin", "fist", "forehead", "point", "mouth"],
            p=[0.28, 0.16, 0.18, 0.16, 0.14, 0.08],
        )
    )
    wobble = rng.normal(0, 0.15, 3)
    out = np.array([side, 0.0, 0.0])
    palm, up, front = np.array([0.3, 7.5, -1.0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0])
    if kind == "cheek":
        mix = rng.uniform(0.2, 0.9)
        target = mix * mark(172, 397) + (1 - mix) * mark(50, 280)
        normal = out + rng.uniform(0.2, 0.8) * front
        fingers = up - rng.uniform(-0.3, 0.5) * front + rng.uniform(-0.1, 0.3) * out
        return _Touch("flat", target, normal + wobble, fingers, normal, palm)
    if kind == "chin":
        normal = front - rng.uniform(0.6, 1.2) * up + 0.2 * out
        fingers = -0.8 * out + rng.uniform(0.3, 0.8) * up
        anchor = np.array([1.6, 8.5, -1.5])
        return _Touch("cup", mark(152, 152), normal + wobble, fingers, normal, anchor)
    if kind == "fist":
        mix = rng.uniform(0, 0.9)
        target = mix * mark(172, 397) + (1 - mix) * mark(152, 152)
        fingers = up - rng.uniform(0.2, 0.7) * out * (0.3 + mix) - 0.3 * front
        normal = front + rng.uniform(-0.2, 0.8) * out
        anchor = np.array([0.3, 9.6, -0.8])
        return _Touch("fist", target, normal + wobble, fingers, -fingers, anchor)
    if kind == "forehead":
        mix = rng.uniform(0, 1)
        target = mix * mark(10, 10) + (1 - mix) * mark(54, 284)
        normal = front + rng.uniform(0.0, 0.6) * out + 0.3 * up
        fingers = -out + rng.uniform(0.3, 1.2) * up
        anchor = np.array([0.3, 11.5, -1.0])
        return _Touch("flat", target, normal + wobble, fingers, normal, anchor)
    if kind == "point":
        target = mark(*((162, 389), (50, 280), (149, 378), (17, 17))[rng.integers(4)])
        fingers = rng.uniform(0.3, 1.2) * up - rng.uniform(0.3, 1.0) * out - 0.5 * front
        normal = front + 0.5 * out
        anchor = np.array([2.9, 17.5, -3.0])
        return _Touch("point", target, normal + wobble, fingers, -fingers, anchor)
    normal = front + 0.15 * out
    fingers = -out + rng.uniform(0.0, 0.7) * up
    return _Touch("flat", mark(13, 13), normal + wobble, fingers, normal, palm)


def _back_off(head: Head, points: np.ndarray, along: np.ndarray) -> float:
    """How far (cm) hand points (N, 3) have to move along a direction so as only to touch.

    What lies below the neck's end is nowhere inside the head.
    """
    outer = head.outer()
    surface, normals = head.vertices[outer].astype(np.float64), head.normals[outer]
    tree = KDTree(surface)
    floor = head.vertices[head.within("neck"), 1].min() + 1.5

    def clear(shift: float, every: int) -> bool:
        moved = points[::every] + shift * along
        moved = moved[moved[:, 1] > floor]
        if len(moved) < 8:
            return True
        near = tree.query(moved)[1]
        depth = ((moved - surface[near]) * normals[near]).sum(axis=1)
        return bool(np.partition(depth, 3 // every)[3 // every] > -0.15)

    far = next((d for d in np.arange(-2.0, 14.0) if clear(d, 4)), 14.0)
    near = far - 1
    for _ in range(5):
        middle = (near + far) / 2
        near, far = (near, middle) if clear(middle, 1) else (middle, far)
    return float(far)


def hand(head: Head, rng: np.random.Generator, skin: tuple[float, float, float]) -> list[Piece]:
    """A hand with some forearm that touches chin, mouth, cheek or forehead; sometimes a sleeve.

    skin: diffuse albedo, linear sRGB.
    """
    side = int(rng.choice([-1, 1]))
    touch = _touch(head, rng, side)
    palm, fingers, arm = _bones(rng, touch.pose)
    step, size = 0.27, rng.uniform(0.88, 1.05)
    ends = np.array([p for bones in (palm, *fingers) for bone in bones for p in bone[:2]])
    low, high = ends.min(axis=0) - 2.2, ends.max(axis=0) + 2.2
    shape = np.ceil((high - low) / step).astype(int) + 1
    field = _field(palm, low, shape, step, 0.9)
    digits = np.full(shape, 3.0)
    for finger in fingers:
        digits = np.minimum(digits, _field(finger, low, shape, step, 0.25))
    vertices, triangles = _surface(_join_smooth(field, digits, 0.5), low, step)

    back = touch.normal / np.linalg.norm(touch.normal)
    up = touch.fingers - back * (touch.fingers @ back)
    if touch.pose in ("fist", "point"):  # here the fingers' direction is the one that counts
        up = touch.fingers / np.linalg.norm(touch.fingers)
        back = back - up * (back @ up)
        back /= np.linalg.norm(back)
    up /= np.linalg.norm(up)
    across = np.cross(up, back)  # where the thumb is, on a right hand or a left hand
    mirror = -1 if side > 0 else 1
    if rng.random() < 0.12:
        mirror = -mirror
    turn = size * np.stack([mirror * -across, up, back], axis=1)
    if np.linalg.det(turn) < 0:
        triangles = triangles[:, ::-1]
    start = touch.target - turn @ touch.anchor
    along = touch.along / np.linalg.norm(touch.along)
    world = vertices @ turn.T + start
    shift = _back_off(head, world[:: max(1, len(world) // 1200)], along) * along
    look = {
        "type": "principled",
        "base_color": rgb_of(np.array(skin) * rng.uniform(0.9, 1.1)),
        "roughness": 0.5,
        "specular": 0.4,
    }
    pieces = [piece_of("hand", world + shift, triangles, two_sided(look))]
    if rng.random() < 0.5:
        reach = np.linspace(rng.uniform(1.5, 9), 24, 16)
        path = reach[:, None] * arm
        wide = np.cross(arm, [0, 0, 1.0])
        half = 3.2 + 2.0 * reach / 22 + 0.12 * wave_field(rng, reach, reach * 0, 2)
        tube = tube_mesh(
            path, wide / np.linalg.norm(wide), np.array([0, 0, 1.0]), (half, half - 0.7)
        )
        stuff = matte(cloth_colour(rng))
        pieces.append(piece_of("cloth", tube[0] @ turn.T + start + shift, tube[1], stuff))
    return pieces
