"""Garments and scarves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from heads import Head
from scipy import ndimage
from scipy.spatial import KDTree

from .pieces import (
    Grid,
    Piece,
    around_at,
    cloth_colour,
    cloth_pieces,
    level_at,
    matte,
    piece_of,
    sheet_mesh,
    softened,
    tube_mesh,
    wave_field,
)


@dataclass(frozen=True)
class _Neck:
    """The neck of a head: its axis's middle (3,), and its lower end's height (N,) by azimuth."""

    points: np.ndarray
    middle: np.ndarray
    azimuth: np.ndarray
    end: np.ndarray

    def radius(self, azimuth: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance of the skin from the axis at azimuths and heights of one shape."""

        def key(at: np.ndarray, height: np.ndarray) -> np.ndarray:
            return np.stack([6 * np.cos(at), 6 * np.sin(at), height], axis=-1)

        flat = self.points - self.middle
        at = np.arctan2(flat[:, 0], flat[:, 2])
        tree = KDTree(key(at, self.points[:, 1]))
        near = tree.query(key(azimuth, y), k=5)[1]
        return np.hypot(flat[:, 0], flat[:, 2])[near].mean(axis=-1)


def _neck(head: Head) -> _Neck:
    """Find the neck's lower end: the edges of its mesh that have one triangle only."""
    count = len(head.vertices)
    ends = head.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    ends.sort(axis=1)
    code, uses = np.unique(ends[:, 0] * count + ends[:, 1], return_counts=True)
    single = code[uses == 1]
    ends = np.unique([single // count, single % count])
    ends = ends[head.within("neck")[ends]]  # teeth have rims of their own
    loop = head.vertices[ends].astype(np.float64)
    middle = (loop.min(axis=0) + loop.max(axis=0)) / 2
    points = head.vertices[head.within("neck")].astype(np.float64)
    azimuth = np.linspace(0, 2 * np.pi, 144, endpoint=False)
    at = np.arctan2(loop[:, 0] - middle[0], loop[:, 2] - middle[2])
    return _Neck(points, middle, azimuth, around_at(loop[:, 1], at, azimuth))


def _rows(neck: _Neck, profile: list[tuple[np.ndarray, np.ndarray]]) -> Grid:
    """Rings (R, C, 3) round the neck of radii and heights (C,) each."""
    rows = [neck.middle * [1, 0, 1] + level_at(neck.azimuth) * r[:, None] for r, _ in profile]
    grid = np.stack(rows)
    grid[..., 1] = np.stack([y for _, y in profile])
    return grid


def _shoulders(neck: _Neck, start: np.ndarray, rng: np.random.Generator) -> Grid:
    """Rings (R, C, 3) from a neckline (C, 3) over shoulders and chest and down."""
    azimuth = neck.azimuth
    half = np.array([rng.uniform(17, 22), 0, rng.uniform(9, 11.5)])
    body = neck.middle * [1, 0, 1] + level_at(azimuth) * half + [0, 0, 0.5]
    side = np.abs(np.sin(azimuth))
    drop = 2.5 + rng.uniform(2.5, 5.5) * side
    rows = []
    for turn in np.linspace(0, np.pi / 2, 16)[1:]:
        out, fall = np.sin(turn), 1 - np.cos(turn)
        row = start + (body - start) * out
        row[:, 1] = start[:, 1] - drop * out - (5 - 1.5 * side) * fall
        rows.append(row)
    wave = wave_field(rng, azimuth, np.zeros_like(azimuth), 6)
    for step in np.linspace(2, 28, 8):
        row = rows[14] + (body - neck.middle * [1, 0, 1]) * (0.02 + 0.03 * wave[:, None])
        row = row * [1, 0, 1] + [0, 1, 0] * (rows[14][:, 1:2] - step)
        rows.append(row)
    return np.stack(rows)


def _collar(neck: _Neck, base: np.ndarray, rng: np.random.Generator) -> Grid:
    """The folded collar of a shirt, open at the front, (R, C, 3)."""
    gap = np.radians(rng.uniform(8, 26))
    azimuth = np.linspace(gap, 2 * np.pi - gap, 120)
    part = _Neck(neck.points, neck.middle, azimuth, neck.end)
    foot = around_at(base, neck.azimuth, azimuth)
    stand = rng.uniform(1.8, 3.2) * (0.8 - 0.2 * np.cos(azimuth))
    tip = rng.uniform(1.5, 4) * np.exp(-(((np.pi - np.abs(azimuth - np.pi)) / 0.6) ** 2))
    skin = part.radius(azimuth, foot)
    high = part.radius(azimuth, foot + stand)
    high = ndimage.gaussian_filter1d(np.minimum(high, skin + 1.0), 4, mode="nearest")
    flare = rng.uniform(1.5, 2.6)
    return _rows(
        part,
        [
            (skin + 0.3, foot - 0.3),
            (0.5 * (skin + high) + 0.4, foot + 0.5 * stand),
            (high + 0.4, foot + stand),
            (high + 0.55, foot + stand + 0.08),
            (high + 0.75, foot + stand - 0.05),
            (0.5 * (skin + high) + 1.3, foot + 0.4 * stand),
            (skin + flare + 0.2 * tip, foot - 0.35 - 0.5 * tip),
            (skin + flare + 0.35 + 0.4 * tip, foot - 0.6 - tip),
        ],
    )


def garment(head: Head, rng: np.random.Generator) -> list[Piece]:
    """A neckline and shoulders that close over the neck's lower end."""
    neck = _neck(head)
    azimuth = neck.azimuth
    base = ndimage.gaussian_filter1d(neck.end, 8, mode="wrap")
    base = base + max(0.0, float((neck.end + 0.35 - base).max())) + rng.uniform(0, 0.4)
    skin = ndimage.gaussian_filter1d(neck.radius(azimuth, base), 2, mode="wrap")
    kind = str(rng.choice(["crew", "collar", "turtleneck"], p=[0.45, 0.3, 0.25]))
    colour = cloth_colour(rng)
    thick, wide = rng.uniform(0.2, 0.4), rng.uniform(1.0, 2.2)
    profile = [
        (skin - 0.6, base - 0.4),
        (skin + 0.02, base),
        (skin + 0.4 * thick, base + 0.12),
        (skin + thick, base + 0.02),
        (skin + thick + 0.45 * wide, base - 0.45 * wide * 0.6),
        (skin + thick + 0.9 * wide, base - 0.9 * wide * 0.6),
        (skin + thick + wide, base - wide * 0.6 - 0.12),
    ]
    if kind == "turtleneck":
        tall = rng.uniform(2.5, 5.5) * (0.72 - 0.28 * np.cos(azimuth))
        chin = head.point(152)[1] - 1.2
        tall = np.clip(tall, 0.6, np.where(np.cos(azimuth) > 0, max(chin - base.max(), 0.6), 9))
        tall = ndimage.gaussian_filter1d(tall, 5, mode="wrap")
        levels = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0]
        radii = [neck.radius(azimuth, base + tall * s) for s in levels]
        radii = softened(np.stack(radii), 0.7, 4)
        loose = rng.uniform(0.25, 0.6)
        profile = [
            (radii[0] - 0.5, base + tall - 0.5),
            (radii[0] + 0.1, base + tall),
            (radii[0] + loose, base + tall + 0.12),
        ]
        swell = [0.25, 0.45, 0.5, 0.5, 0.4, 0.2]
        profile += [
            (r + loose + w, base + tall * s - 0.1)
            for r, s, w in zip(radii, levels, swell, strict=True)
        ]
    grid = _rows(neck, profile)
    body = np.concatenate([grid, _shoulders(neck, grid[-1], rng)])
    pieces = cloth_pieces(body, True, rng, colour)
    if kind == "collar":
        sheet = sheet_mesh(_collar(neck, base, rng), wrap=False)
        pieces.append(piece_of("cloth", *sheet, matte(colour)))
    return pieces


def _push(points: np.ndarray, ring: np.ndarray, reach: np.ndarray, middle: np.ndarray) -> Any:
    """Radius (C,) about a vertical axis that clears points (N, 3) near a ring's heights (C,)."""
    flat = points - middle
    at, radius = np.arctan2(flat[:, 0], flat[:, 2]), np.hypot(flat[:, 0], flat[:, 2])
    azimuth = np.linspace(0, 2 * np.pi, len(ring), endpoint=False)
    turn = np.abs((at[None] - azimuth[:, None] + np.pi) % (2 * np.pi) - np.pi)
    near = (turn < np.radians(9)) & (np.abs(points[None, :, 1] - ring[:, None]) < reach)
    found = np.where(near, radius[None], 0).max(axis=1)
    found = np.maximum(found, np.median(found[found > 0]) * 0.9)
    found = ndimage.maximum_filter1d(found, 3, mode="wrap")
    return ndimage.gaussian_filter1d(found, 2.5, mode="wrap")


def scarf(head: Head, rng: np.random.Generator) -> list[Piece]:
    """One to three thick turns round the neck, up to the chin or over it; sometimes a loose end."""
    neck = _neck(head)
    points = head.vertices[head.outer() & ~head.within("ears")].astype(np.float64)
    points = points[points[:, 1] < head.point(152)[1] + 8][::2]
    azimuth = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    chin = float(head.point(152)[1])
    base = float(neck.end.mean())
    turns = int(rng.integers(1, 4))
    size = rng.uniform(1.6, 2.6)
    colour = cloth_colour(rng)
    top = chin - rng.uniform(-2.5, 2.0) - size
    pattern = int(rng.integers(2**31))  # one for all turns
    pieces = []
    for level in np.linspace(top, base - 0.5, turns) if turns > 1 else [top]:
        tilt, phase = rng.uniform(0.2, 1.1), rng.normal(0, 0.5)
        height = level + 0.8 - tilt * np.cos(azimuth - phase)
        half = size * rng.uniform(0.85, 1.15)
        clear = _push(points, height, np.full((len(azimuth), 1), 0.7 * half), neck.middle)
        section = np.linspace(0, 2 * np.pi, 49)[:-1][:, None]
        fold = 1 + 0.10 * wave_field(rng, azimuth, 0 * section, 5)
        fold = fold + 0.07 * np.cos(rng.integers(4, 8) * section + 2 * np.sin(azimuth + phase))
        deep = 0.75 * half
        out = clear + 0.72 * deep + deep * fold * np.cos(section)
        grid = neck.middle * [1, 0, 1] + out[..., None] * level_at(azimuth)
        grid[..., 1] = height + half * fold * np.sin(section)
        grid = np.concatenate([grid, grid[:1]])
        pieces += cloth_pieces(grid, True, np.random.default_rng(pattern), colour)
    if rng.random() < 0.45:
        side, start = rng.choice([-1, 1]), grid[:, np.abs(azimuth - 0.3).argmin()].mean(axis=0)
        t = np.linspace(0, 1, 24)
        chest = max(start[2], neck.middle[2] + 13.0)
        x = neck.middle[0] + side * (1.5 + 2.5 * t)
        z = start[2] + (chest - start[2]) * (1 - np.exp(-9 * t)) + 1.0 * t
        path = np.stack([x, start[1] - 24 * t, z], axis=1)
        mesh = tube_mesh(
            path, np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), (size * 1.4, 0.9), power=3
        )
        pieces.append(piece_of("cloth", *mesh, matte(colour)))
    return pieces
