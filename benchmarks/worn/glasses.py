"""Spectacles and sunglasses."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from heads import Head
from scipy import ndimage

from .pieces import (
    LEFT_EYE,
    RIGHT_EYE,
    Piece,
    around_at,
    faces_of,
    joined,
    masked,
    metal_bsdf,
    piece_of,
    plastic_bsdf,
    rgb_of,
    tube_mesh,
    two_sided,
)

Tint = Literal["clear", "tinted", "any"]

#: Outlines of lenses: height over width, exponent of the superellipse, how much the top is wider
#: than the bottom, lift of the upper outer corner, outward droop of the lower half.
SHAPES = {
    "round": ((0.92, 1.0), (2.0, 2.2), 0.0, 0.0, 0.0),
    "oval": ((0.62, 0.80), (2.0, 2.4), 0.0, 0.0, 0.0),
    "rectangle": ((0.50, 0.72), (3.5, 6.0), 0.03, 0.0, 0.0),
    "trapezoid": ((0.72, 0.88), (2.7, 3.6), 0.09, 0.06, 0.0),
    "cat-eye": ((0.62, 0.80), (2.4, 3.0), 0.06, 0.30, 0.0),
    "aviator": ((0.82, 0.95), (2.3, 2.7), 0.05, 0.0, 0.16),
}
METALS = {
    "steel": (0.60, 0.60, 0.62),
    "gold": (0.85, 0.62, 0.30),
    "copper": (0.75, 0.45, 0.33),
    "gunmetal": (0.13, 0.13, 0.14),
}
PLASTICS = {
    "black": (0.012, 0.012, 0.013),
    "tortoise": (0.10, 0.035, 0.012),
    "brown": (0.16, 0.08, 0.04),
    "red": (0.35, 0.02, 0.03),
    "blue": (0.02, 0.06, 0.25),
    "white": (0.75, 0.74, 0.72),
    "skin-like": (0.55, 0.36, 0.26),
}
TINTS = {
    "grey": (0.02, 0.02, 0.022),
    "brown": (0.045, 0.022, 0.01),
    "green": (0.014, 0.03, 0.016),
    "blue": (0.01, 0.02, 0.05),
}


def _frame_material(rng: np.random.Generator, metal: bool) -> dict[str, Any]:
    if metal:
        colour = np.array(list(METALS.values())[rng.integers(len(METALS))])
        return metal_bsdf(colour, rng.uniform(0.08, 0.3))
    names = list(PLASTICS)
    weights = np.array([0.34, 0.2, 0.12, 0.08, 0.08, 0.06, 0.12])
    colour = np.array(PLASTICS[names[rng.choice(len(names), p=weights)]]) * rng.uniform(0.7, 1.3)
    plastic = plastic_bsdf(colour, rng.uniform(0.05, 0.25))
    if rng.random() < 0.15:  # transparent
        clear = plastic_bsdf(0.5 + 0.5 * np.sqrt(colour), 0.05)
        return masked(clear, rng.uniform(0.25, 0.5))
    return plastic


def _outline(rng: np.random.Generator, half_width: float, shape: str) -> np.ndarray:
    """Outline of a lens, (128, 2) cm about its centre, x away from the nose, y up, evenly spaced.

    It begins at the outer end and runs up and round.
    """
    aspect, exponent, taper, lift, droop = SHAPES[shape]
    a, n = half_width, rng.uniform(*exponent)
    b = a * rng.uniform(*aspect)
    angle = np.linspace(0, 2 * np.pi, 2001)
    u, w = (np.sign(f) * np.abs(f) ** (2 / n) for f in (np.cos(angle), np.sin(angle)))
    x = a * (u * (1 + taper * w) + droop * np.maximum(-w, 0))
    y = b * (w * np.where(w > 0, 1 - 0.9 * droop, 1 + 0.4 * droop))
    y = y + b * lift * np.maximum(u, 0) ** 2 * (w + 1) / 2
    length = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    even = np.linspace(0, length[-1], 128, endpoint=False)
    return np.stack([np.interp(even, length, x), np.interp(even, length, y)], axis=1)


@dataclass(frozen=True)
class _Fit:
    """Where glasses sit: the surface of both lenses, z = shift + tilt y - curvature.

    outline (N, 2) of a lens about its centre (x, y), cm; the middle is the x of the nose.
    """

    outline: np.ndarray
    centre: np.ndarray
    middle: float
    tilt: float
    wrap: float
    bulge: float
    shift: float = 0.0

    def depth(self, x: Any, y: Any) -> Any:
        """z of the lens surface at x (cm from the nose, outwards) and y, before the shift."""
        bow = (x - self.centre[0]) ** 2 + (y - self.centre[1]) ** 2
        return self.tilt * (y - self.centre[1]) - x**2 * self.wrap / 2 - bow * self.bulge / 2

    def place(self, local: np.ndarray, side: int, forward: Any = 0.0) -> np.ndarray:
        """Points (N, 3) of (N, 2) about a lens centre; side +1 is the subject's left."""
        x, y = (local + self.centre).T
        z = self.depth(x, y) + self.shift + forward
        return np.stack([self.middle + side * x, y, z], axis=1)


def _needed_shift(head: Head, fit: _Fit, rim: float, depth: float) -> float:
    """How far forward the lenses have to go to clear the face by a rim of this size, cm."""
    points = head.vertices[head.vertices[:, 2] > _behind(head)].astype(np.float64)
    x, y = np.abs(points[:, 0] - fit.middle), points[:, 1]
    local = np.stack([x, y], axis=1) - fit.centre
    border = around_at(
        np.hypot(*fit.outline.T),
        np.arctan2(fit.outline[:, 1], fit.outline[:, 0]),
        np.arctan2(*local.T[::-1]),
    )
    inside = np.hypot(*local.T) < border + 2 * rim + 0.05
    eyes = [head.point(*corners) for corners in (RIGHT_EYE, LEFT_EYE)]
    near = np.minimum(*(np.hypot(*(points[:, :2] - e[:2]).T) for e in eyes)) < 1.7
    clearance = np.where(near, 0.5, depth / 2 + 0.08)
    return float((points[:, 2] - fit.depth(x, y) + clearance)[inside].max())


def _behind(head: Head) -> float:
    """z (cm) behind which nothing of the face touches glasses."""
    return float(head.point(33, 263)[2] - 4.0)


def _fit(
    head: Head, rng: np.random.Generator, shape: str, big: float, size: tuple[float, float]
) -> _Fit:
    """Choose a lens and its place so that it clears eyes, cheeks and nose."""
    rim, depth = size
    right, left = head.point(*RIGHT_EYE), head.point(*LEFT_EYE)
    scale = float(np.linalg.norm(head.landmarks[356] - head.landmarks[127])) / 15.3
    half = rng.uniform(2.2, 2.75) * scale * big * (0.9 if shape == "round" else 1.0)
    outline = _outline(rng, half, shape)
    eye = (right + left) / 2
    slide = rng.uniform(0, 1.4) if rng.random() < 0.25 else 0.0
    y = eye[1] - rng.uniform(0.1, 0.6) * scale - slide
    if slide == 0:  # not above the brows
        y = min(y, head.point(105, 334)[1] + 0.7 - outline[:, 1].max())
    gap = rng.uniform(0.75, 1.1) * scale
    tilt, wrap = np.tan(np.radians(rng.uniform(3, 12))), rng.uniform(0.015, 0.045)
    bulge = rng.uniform(0.02, 0.09)
    front, middle = max(right[2], left[2]), float(head.point(168, 6)[0])
    for _ in range(7):
        centre = np.array([gap - outline[:, 0].min(), y])
        fit = _Fit(outline, centre, middle, tilt, wrap, bulge)
        shift = _needed_shift(head, fit, rim, depth)
        at_eye = fit.depth(abs(left[0] - right[0]) / 2, eye[1])
        if shift + at_eye < front + 1.9:
            break
        gap += 0.12
    return _Fit(outline, centre, middle, tilt, wrap, bulge, shift)


def _lens(fit: _Fit, side: int) -> tuple[np.ndarray, np.ndarray]:
    """A lens as a single sheet: (12, 128, 3) rings from the centre, and its triangles."""
    rings = np.linspace(0, 1.0, 12)[:, None, None] * fit.outline[None]
    points = fit.place(rings.reshape(-1, 2), side)
    return points, faces_of(12, len(fit.outline), wrap=True)


def _rim(fit: _Fit, side: int, size: tuple[float, float], heavy: float, upper: bool) -> Any:
    """The rim round a lens, or only round its upper half."""
    outline = fit.outline
    ahead, behind = np.roll(outline, -1, axis=0), np.roll(outline, 1, axis=0)
    tangent = ahead - behind
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    top = np.clip(outline[:, 1] / outline[:, 1].max(), 0, 1)
    half = size[0] / 2 * (1 + heavy * top)
    path = fit.place(outline + normal * (0.7 * half)[:, None], side)
    wide = np.stack([side * normal[:, 0], normal[:, 1], np.zeros(len(normal))], axis=1)
    if upper:
        keep = np.flatnonzero(outline[:, 1] > -0.1 * outline[:, 1].max())
        start = np.flatnonzero(np.diff(keep) > 1)
        keep = np.roll(keep, -(start[0] + 1)) if len(start) else keep
        path, wide, half = path[keep], wide[keep], half[keep]
    return tube_mesh(path, wide, np.array([0, 0, 1.0]), (half, size[1] / 2), not upper, 3.0)


def _at_height(fit: _Fit, height: float, inner: bool) -> np.ndarray:
    """Point (2,) of the outline, about its centre, at a height of -1 to 1 on one of its sides."""
    side = fit.outline[(fit.outline[:, 0] < 0) == inner]
    top = fit.outline[:, 1].max()
    return side[np.argmin(np.abs(side[:, 1] - height * top))]


def _bridge(head: Head, fit: _Fit, height: float, size: tuple[float, float]) -> Any:
    """A bar over the nose between the lenses, bowed forward as far as the nose asks for."""
    end = _at_height(fit, height, inner=True)
    t = np.linspace(-1, 1, 25)
    ends = [fit.place(end[None], side)[0] for side in (-1, 1)]
    path = ends[0] + (ends[1] - ends[0]) * ((t + 1) / 2)[:, None]
    path[:, 1] += 0.18 * (1 - t**2)
    near = head.vertices[np.abs(head.vertices[:, 0] - fit.middle) < 2.5].astype(np.float64)
    near = near[near[:, 2] > _behind(head)]
    reach = np.abs(near[None, :, :2] - path[:, None, :2]) < np.array([0.22, 0.2 + size[0] / 2])
    nose = np.where(reach.all(axis=2), near[None, :, 2], -np.inf).max(axis=1)
    arch = np.sqrt(np.maximum(1 - t**2, 0.04))
    bow = max(0.12, float(((nose + size[1] / 2 + 0.06 - path[:, 2]) / arch).max()))
    path[:, 2] += bow * arch * (1 - t**8)
    tall = size[0] / 2 * (1 + (0.8 * t**4 if size[0] > 0.2 else 0))  # plastic widens to its ends
    return tube_mesh(
        path, np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), (tall, size[1] / 2), power=2.5
    )


def _temple(head: Head, fit: _Fit, side: int, height: float, size: tuple[float, float]) -> Any:
    """The arm from a lens's outer end to above the ear and down behind it."""
    ear = head.vertices[head.within("ears") & (side * (head.vertices[:, 0] - fit.middle) > 0)]
    top = ear[ear[:, 1].argmax()].astype(np.float64)
    skull = head.vertices[head.within("skin", "scalp")].astype(np.float64)
    skull = skull[side * (skull[:, 0] - fit.middle) > 3]
    start = fit.place(_at_height(fit, height, inner=False)[None], side)[0]
    tall, thick = size
    corner = start + np.array([side * (0.15 + thick), 0.05, -0.1 - thick])
    rest = np.array([top[0], top[1] - 0.05, top[2] + 0.4])
    drop = rest + np.array([-side * 0.5, -2.6, -2.2])
    knots = np.stack(
        [start, corner, 0.5 * (corner + rest), rest, rest + np.array([0, -0.35, -0.8]), drop]
    )
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    even = np.linspace(0, length[-1], 60)
    path = np.stack([np.interp(even, length, knots[:, i]) for i in range(3)], axis=1)
    path[4:] = ndimage.gaussian_filter1d(path, 1.5, axis=0, mode="nearest")[4:]
    reach = np.abs(skull[None, :, 1:] - path[:, None, 1:]) < np.array([0.35 + tall / 2, 0.4])
    out = side * (skull[:, 0] - fit.middle)
    wall = np.where(reach.all(axis=2), out, -np.inf).max(axis=1) + thick / 2 + 0.04
    x = side * (path[:, 0] - fit.middle)
    ahead = path[:, 2] > rest[2]
    x = np.where(ahead, np.maximum(x, wall), np.where(np.isfinite(wall), wall, x))
    x[4:] = np.maximum(ndimage.gaussian_filter1d(x, 2.0, mode="nearest"), wall)[4:]
    path[:, 0] = fit.middle + side * x
    along = np.gradient(path, axis=0)
    wide = np.cross(np.array([side, 0, 0.0]), along)
    wide /= np.linalg.norm(wide, axis=1, keepdims=True)
    deep = np.cross(wide, along)
    deep /= np.linalg.norm(deep, axis=1, keepdims=True)
    return tube_mesh(path, wide, deep, (tall / 2, thick / 2), power=3.0)


def _pads(head: Head, fit: _Fit) -> list[Any]:
    """Two nose pads on wires, each from the lens's inner edge to the side of the nose."""
    parts = []
    skin = head.vertices[head.within("skin")].astype(np.float64)
    for side in (-1, 1):
        start = fit.place(_at_height(fit, -0.15, inner=True)[None], side)[0]
        target = start + np.array([-side * 0.25, -0.1, -0.35])
        nearest = skin[((skin - target) ** 2).sum(axis=1).argmin()]
        pad = nearest + 0.17 * (start - nearest) / max(np.linalg.norm(start - nearest), 0.17)
        path = np.linspace(start, pad, 8)
        deep, wide = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
        parts.append(tube_mesh(path, wide, np.array([0, 1.0, 0]), (0.03, 0.03)))
        stem = np.linspace(pad - [0, 0.4, 0], pad + np.array([-side * 0.05, 0.4, 0]), 9)
        swell = np.sqrt(np.maximum(1 - np.linspace(-1, 1, 9) ** 2, 0.05))
        parts.append(tube_mesh(stem, wide, deep, (0.06 * swell, 0.18 * swell)))
    return parts


def _lens_pieces(
    fit: _Fit, meshes: list[Any], rng: np.random.Generator, tinted: bool
) -> list[Piece]:
    """The lenses: clear glass, a dark tint, one that fades downwards, or a mirror."""
    vertices, faces = joined(meshes)
    if not tinted:
        glass = {"type": "thindielectric", "int_ior": float(rng.uniform(1.2, 1.55))}
        return [piece_of("clear lens", vertices, faces, glass)]
    colour = np.array(list(TINTS.values())[rng.integers(len(TINTS))]) * rng.uniform(0.5, 1.8)
    coat = two_sided({"type": "plastic", "diffuse_reflectance": rgb_of(colour)})
    if rng.random() < 0.15:
        hue = np.array(colorsys.hsv_to_rgb(rng.random(), rng.uniform(0, 0.6), 0.6))
        coat = metal_bsdf(hue, 0.03)
    opacity = rng.uniform(0.75, 0.97)
    if rng.random() > 0.3:
        return [piece_of("tinted lens", vertices, faces, masked(coat, opacity))]
    height = vertices[faces].mean(axis=1)[:, 1] - fit.centre[1]
    low, high = fit.outline[:, 1].min(), fit.outline[:, 1].max()
    band = np.clip(((height - low) / (high - low) * 10).astype(int), 0, 9)
    lightest = rng.uniform(0.3, 0.6)
    steps = [(band == i, lightest + (opacity - lightest) * min(1, i / 7)) for i in range(10)]
    return [
        piece_of("tinted lens", vertices, faces[m], masked(coat, o)) for m, o in steps if m.any()
    ]


def glasses(head: Head, rng: np.random.Generator, tint: Tint = "any") -> list[Piece]:
    """Spectacles or sunglasses: rims of some shape and stuff, bridge, temples, two lenses."""
    tinted = tint == "tinted" or (tint == "any" and rng.random() < 0.4)
    shape = str(rng.choice(list(SHAPES)))
    style = str(rng.choice(["full", "half", "none"], p=[0.72, 0.15, 0.13]))
    metal = bool(rng.random() < (0.85 if style != "full" or shape == "aviator" else 0.4))
    width = rng.uniform(0.08, 0.16) if metal else rng.uniform(0.18, 0.5)
    size = (width, width * 1.1 if metal else rng.uniform(0.28, 0.42))
    big = rng.uniform(1.05, 1.2) if tinted else rng.uniform(0.9, 1.08)
    rim = 0.0 if style == "none" else size[0]
    fit = _fit(head, rng, shape, big, (rim, 0.1 if style == "none" else size[1]))
    stuff = _frame_material(rng, metal)
    parts = []
    if style != "none":
        heavy = 0.0 if metal else rng.uniform(0, 0.7)
        parts += [_rim(fit, side, size, heavy, style == "half") for side in (-1, 1)]
    bar = (width, width) if metal else (rng.uniform(0.35, 0.7), size[1] * 0.8)
    parts.append(_bridge(head, fit, rng.uniform(0.15, 0.5), bar))
    if metal and shape == "aviator":
        parts.append(_bridge(head, fit, 0.97, bar))
    arm = (width * 1.3, width) if metal else (rng.uniform(0.35, 1.1), rng.uniform(0.2, 0.35))
    height = rng.uniform(0.3, 0.8)
    parts += [_temple(head, fit, side, height, arm) for side in (-1, 1)]
    if metal or rng.random() < 0.3:
        parts += _pads(head, fit)
    frame = piece_of("frame", *joined(parts), stuff)
    return [frame, *_lens_pieces(fit, [_lens(fit, side) for side in (-1, 1)], rng, tinted)]
