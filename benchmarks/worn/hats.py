"""Beanies, caps, hats with a brim, headbands, headscarves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from heads import Head
from scipy import ndimage
from scipy.spatial import KDTree

from unlit.perception.topology import FACE_OVAL

from .pieces import (
    LEFT_EYE,
    RIGHT_EYE,
    Grid,
    Piece,
    around_at,
    cloth_colour,
    cloth_pieces,
    hull_of,
    level_at,
    matte,
    piece_of,
    reach_of,
    sheet_mesh,
    slab_mesh,
    softened,
    wave_field,
)


@dataclass(frozen=True)
class _Band:
    """A slanted plane through the head, where a hat ends, and the head above it.

    turn (3, 3): columns are the hat's own axes (left, up, front) in the head's frame; origin (3,).
    planes: of the convex hull of what is above, in the hat's axes.
    """

    origin: np.ndarray
    turn: np.ndarray
    planes: np.ndarray
    height: float

    def world(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the hat's axes in the head's frame."""
        return points @ self.turn.T + self.origin

    def ring(self, azimuth: np.ndarray, height: float = 0.0) -> np.ndarray:
        """Radius of the head at a height (cm) above the plane."""
        return reach_of(self.planes, np.array([0, height, 0]), level_at(azimuth))


def _band(
    head: Head, rng: np.random.Generator, front: tuple[float, float], back: tuple[float, float]
) -> _Band:
    """A plane that meets forehead and nape between two heights each.

    front, back: as parts of the way from the eyes up to the crown, at the middle of the head.
    """
    outer = head.vertices[head.within("skin", "eyebrows", "scalp", "ears")].astype(np.float64)
    eye, crown = head.point(*RIGHT_EYE, *LEFT_EYE), outer[:, 1].max()
    central = outer[np.abs(outer[:, 0] - eye[0]) < 1.5]
    ends = []
    for span, sign in ((front, 1), (back, -1)):
        y = eye[1] + rng.uniform(*span) * (crown - eye[1])
        half = central[sign * (central[:, 2] - eye[2] + 8) > 0]
        ends.append(half[np.abs(half[:, 1] - y).argmin()])
    forward = (ends[0] - ends[1]) * [0, 1, 1]
    forward /= np.linalg.norm(forward)
    roll = np.radians(rng.normal(0, 2.5))
    left = np.array([np.cos(roll), np.sin(roll), 0])
    up = np.cross(forward, left)
    up /= np.linalg.norm(up)
    turn = np.stack([np.cross(up, forward), up, forward], axis=1)
    origin = (ends[0] + ends[1]) / 2
    local = (outer - origin) @ turn
    ears = head.within("ears")[head.within("skin", "eyebrows", "scalp", "ears")]
    tips = local[ears]
    covered = (tips[:, 1] > 0).mean() > 0.12  # else the hat would only pinch the ears' tips
    keep = (local[:, 1] > -0.8) & (covered | ~ears)
    return _Band(origin, turn, hull_of(local[keep]), float(local[:, 1].max()))


def _crown(band: _Band, rows: int = 34, columns: int = 160) -> tuple[np.ndarray, ...]:
    """Azimuth and angle from the top, (R, C) rad, directions (R, C, 3) and radius of the head."""
    angle, azimuth = np.meshgrid(
        np.linspace(0, np.pi / 2, rows),
        np.linspace(0, 2 * np.pi, columns, endpoint=False),
        indexing="ij",
    )
    direction = np.sin(angle)[..., None] * level_at(azimuth)
    direction[..., 1] = np.cos(angle)
    radius = reach_of(band.planes, np.zeros(3), direction)
    smooth = softened(radius, 1.5, 3)
    return azimuth, angle, direction, np.maximum(smooth, radius - 0.1)


def _hem(grid: Grid, thickness: float, gap: float) -> Grid:
    """Add rows below the last one that turn round the edge and back to the head, in hat axes."""
    last = grid[-1]
    inward = -last * [1, 0, 1]
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    turns = [(0.15, -0.25), (0.5, -0.35), (0.85, -0.25), (1.0, 0.0)]
    rows = [last + inward * thickness * s + [0, thickness * y, 0] for s, y in turns]
    rows.append(last + inward * (thickness + gap) + [0, 0.25, 0])
    return np.concatenate([grid, np.stack(rows)])


def _ball(centre: np.ndarray, radius: Any, rows: int = 20, columns: int = 32) -> Grid:
    """A ball as a grid (R, C, 3); radius a number or (R, C)."""
    angle, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns, False), indexing="ij"
    )
    direction = np.sin(angle)[..., None] * level_at(azimuth)
    direction[..., 1] = np.cos(angle)
    return centre + direction * np.broadcast_to(radius, angle.shape)[..., None]


def _beanie(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A knitted cap, from just over the brows to the nape, over the ears or the tips of them."""
    band = _band(head, rng, (0.3, 0.7), (-0.45, -0.05))
    azimuth, angle, direction, radius = _crown(band)
    off = rng.uniform(0.5, 1.0)
    radius = radius + off + 0.12 * wave_field(rng, azimuth, angle, 5) * np.sin(angle)
    if rng.random() < 0.6:
        radius += 0.05 * np.cos(rng.integers(20, 33) * azimuth) * np.sin(angle)
    grid = direction * radius[..., None]
    rise = np.clip(grid[..., 1] / grid[..., 1].max(), 0, 1) ** 2
    grid[..., 1] *= 1 + rng.uniform(0, 0.25)
    grid[..., 2] -= rng.uniform(0, 3.5) * rise * (rng.random() < 0.5)
    if rng.random() < 0.6:
        cuff = rng.uniform(3, 6)
        step = 0.5 - 0.5 * np.tanh((grid[..., 1:2] - cuff) / 0.25)
        grid += 0.4 * step * level_at(azimuth)
        off += 0.4
    colour = cloth_colour(rng)
    pieces = cloth_pieces(band.world(_hem(grid, 0.45, off)), True, rng, colour)
    if rng.random() < 0.25:
        size = rng.uniform(1.8, 3.0)
        bumps = size * (1 + 0.08 * rng.standard_normal((20, 32)))
        ball = _ball(grid[0, 0] + [0, 0.7 * size, 0], ndimage.gaussian_filter(bumps, 0.5))
        stuff = matte(cloth_colour(rng) if rng.random() < 0.5 else colour)
        pieces.append(piece_of("cloth", *sheet_mesh(band.world(ball), True), stuff))
    return pieces


def _cap(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A cap with a visor at the front, seldom at the back."""
    band = _band(head, rng, (0.38, 0.72), (-0.1, 0.15))
    azimuth, angle, direction, radius = _crown(band)
    backward = rng.random() < 0.12
    ahead = np.pi if backward else 0.0
    off = rng.uniform(0.4, 0.8)
    front = np.maximum(np.cos(azimuth - ahead), 0) ** 2 * np.sin(2 * np.minimum(angle, 1.2))
    radius = radius + off + rng.uniform(0.2, 0.9) * front
    radius += 0.05 * wave_field(rng, azimuth, angle, 4) * np.sin(angle)
    grid = direction * radius[..., None]
    colour = cloth_colour(rng)
    pieces = cloth_pieces(band.world(_hem(grid, 0.25, off)), True, rng, colour)
    wide, long = np.radians(rng.uniform(52, 68)), rng.uniform(5.5, 7.5)
    u = np.linspace(-1, 1, 49)[None]
    t = np.linspace(-0.08, 1, 14)[:, None]
    at = wide * u + ahead
    edge = level_at(at) * around_at(np.linalg.norm(grid[-1], axis=1), azimuth[-1], at)[..., None]
    out = long * t * np.sqrt(np.maximum(1 - np.abs(u) ** 2.6, 0))
    droop = np.tan(np.radians(rng.uniform(2, 24))) * out + rng.uniform(0.1, 1.8) * u**2 * t
    droop += rng.uniform(0, 0.02) * out**2
    visor = edge + out[..., None] * np.array([0, 0, np.cos(ahead)])
    visor[..., 1] += 0.15 - droop
    vertices, faces = slab_mesh(visor, 0.22, wrap=False)
    stuff = matte(cloth_colour(rng) if rng.random() < 0.35 else colour)
    pieces.append(piece_of("cloth", band.world(vertices), faces, stuff))
    return pieces


def _brimmed(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A hat with a brim all round: flat, raised, hanging, or steep as of a bucket hat."""
    band = _band(head, rng, (0.4, 0.75), (-0.05, 0.2))
    azimuth = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    off = rng.uniform(0.4, 0.9)
    ring = ndimage.gaussian_filter1d(band.ring(azimuth), 3, mode="wrap") + off
    height, taper = band.height + rng.uniform(0.8, 3.0), rng.uniform(0, 0.12)
    power = rng.uniform(3.5, 7)
    s = 1 - np.linspace(0, 1, 36) ** 2.5
    scale = (1 - taper * s) * np.maximum(1 - s**power, 0) ** (1 / power)
    scale[-1] = 1.0
    rows = scale[:, None, None] * ring[:, None] * level_at(azimuth)
    rows[..., 1] = height * s[:, None]
    top = np.clip(s - 0.6, 0, 1)[:, None] / 0.4
    rows[..., 1] -= rng.uniform(0, 1.5) * top * (0.4 - 0.6 * np.abs(np.sin(azimuth)))  # the pinch
    colour = cloth_colour(rng)
    pieces = cloth_pieces(band.world(_hem(rows, 0.25, off)), True, rng, colour)
    if rng.random() < 0.5:
        tall = rng.uniform(1.5, 3.5)
        up = np.linspace(0.1, tall, 6)
        ribbon = ((1 - taper * up / height)[:, None] * ring + 0.12)[..., None] * level_at(azimuth)
        ribbon[..., 1] = up[:, None]
        stuff = matte(cloth_colour(rng))
        pieces.append(piece_of("cloth", *sheet_mesh(band.world(ribbon), True), stuff))
    bucket = rng.random() < 0.3
    long = rng.uniform(4, 6) if bucket else rng.uniform(4, 9)
    slope = rng.uniform(35, 60) if bucket else rng.uniform(-12, 22)
    t = np.linspace(-0.06, 1, 16)[:, None]
    lean = np.radians(slope)
    brim = (ring + long * t * np.cos(lean))[..., None] * level_at(azimuth)
    wave = rng.uniform(0, 1.2) * np.cos(2 * azimuth + rng.uniform(-0.5, 0.5)) * t**2
    brim[..., 1] = 0.1 - long * t * np.sin(lean) - wave
    vertices, faces = slab_mesh(brim, 0.2, wrap=True)
    pieces.append(piece_of("cloth", band.world(vertices), faces, matte(colour)))
    return pieces


def _headband(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A band of cloth round forehead and back of the head."""
    band = _band(head, rng, (0.35, 0.75), (-0.1, 0.25))
    t = np.linspace(0, 1, 16)[:, None]
    azimuth = np.broadcast_to(np.linspace(0, 2 * np.pi, 160, endpoint=False), (16, 160))
    width = rng.uniform(1.5, 6.0)
    height = np.broadcast_to(width * t, azimuth.shape)
    rings = np.stack([band.ring(azimuth[0], h) for h in height[:, 0]])
    radius = softened(rings, 1, 3)
    radius += 0.12 + rng.uniform(0.2, 0.5) * np.sqrt(np.sin(np.pi * np.clip(t, 0.01, 0.99)))
    radius += 0.05 * wave_field(rng, azimuth, 3 * t, 4)
    grid = radius[..., None] * level_at(azimuth)
    grid[..., 1] = height
    ends = [grid[i : i + 1] * [0.95, 1, 0.95] for i in (0, -1)]
    grid = np.concatenate([ends[0], grid, ends[1]])[::-1]
    return cloth_pieces(band.world(grid), True, rng, cloth_colour(rng))


def _headscarf(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A scarf over hair, ears and neck that leaves the face free."""
    eye = head.point(*RIGHT_EYE, *LEFT_EYE)
    centre = np.array([eye[0], eye[1] - 3.0, eye[2] - 7.0])
    oval = head.landmarks[list(FACE_OVAL)].astype(np.float64)
    oval = oval[np.isfinite(oval).all(axis=1)]
    part = np.clip((oval[:, 1] - eye[1]) / 5.0, -2, 1)
    oval[:, 1] += np.where(part > 0, rng.uniform(-1.0, 3.0) * part, 0.35 * part)
    oval[:, 0] = eye[0] + (oval[:, 0] - eye[0]) * rng.uniform(0.9, 1.0)

    def polar(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Azimuth about the z axis and angle from it."""
        ray = points - centre
        return np.arctan2(ray[:, 0], ray[:, 1]), np.arctan2(np.hypot(*ray.T[:2]), ray[:, 2])

    azimuth = np.linspace(0, 2 * np.pi, 168, endpoint=False)
    edge_at, edge = polar(oval)
    opening = ndimage.gaussian_filter1d(around_at(edge, edge_at, azimuth), 3, mode="wrap")
    outer = head.vertices[head.outer()].astype(np.float64)
    at, angle = polar(outer)
    covered = outer[angle > around_at(opening, azimuth, at) - np.radians(1.5)]
    wide, deep = rng.uniform(9, 15), rng.uniform(8.5, 12.5)
    foot = level_at(azimuth) * [wide, 0, deep] + [eye[0], -21 + eye[1], centre[2] - 4]
    planes = hull_of(np.concatenate([covered, foot]))
    t = np.linspace(0, 1, 56)[:, None]
    angle = opening + (np.pi - opening) * t
    around = np.broadcast_to(azimuth, angle.shape)
    direction = np.stack(
        [np.sin(angle) * np.sin(around), np.sin(angle) * np.cos(around), np.cos(angle)], axis=-1
    )
    radius = reach_of(planes, centre, direction)
    smooth = softened(radius, 1.2, 2.0)
    radius = np.where(direction[..., 1] < -0.3, smooth, np.maximum(smooth, radius - 0.15))
    ray = covered - centre
    far = np.linalg.norm(ray, axis=1)
    near = KDTree(ray / far[:, None]).query(direction[0], k=6)[1]
    skin = ndimage.gaussian_filter1d(far[near].max(axis=1), 2, mode="wrap")
    blend = np.clip(t / rng.uniform(0.06, 0.14), 0, 1)
    blend = blend * blend * (3 - 2 * blend)
    radius = np.maximum(radius, skin) * blend + skin * (1 - blend)
    rise = np.clip(t / 0.08, 0, 1) ** 0.5
    folds = 0.25 + 0.35 * np.clip(-direction[..., 1] - 0.2, 0, 1)
    loose = rng.uniform(0.4, 1.1) + folds * wave_field(rng, around, 6 * t, 9)
    radius += 0.12 + rise * (0.2 + np.maximum(loose, 0))
    grid = centre + direction * radius[..., None]
    tuck = [centre + direction[0] * (radius[0] + d)[:, None] for d in (-0.6, -0.05)]
    return cloth_pieces(np.concatenate([np.stack(tuck), grid]), True, rng, cloth_colour(rng))


def hat(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A beanie, a cap with a visor, a hat with a brim, a headscarf, or a headband."""
    kinds = [_beanie, _cap, _brimmed, _headscarf, _headband]
    return kinds[rng.choice(5, p=[0.26, 0.22, 0.2, 0.18, 0.14])](head, rng)
