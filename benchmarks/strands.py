"""Hair, brows and beards as strands that grow from the default head model.

All in the head's frame (head/model.py): x to the subject's left, y up, the face looks along +z, cm.
A style is a handful of numbers; what differs between two heads of one style is drawn at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from heads import Head
from scipy.spatial import KDTree

from unlit.perception.topology import LEFT_EYEBROW, RIGHT_EYEBROW

_POINTS = 12  # along a strand
_CLEARANCE = 0.12  # cm between hair and skin

#: The hairline of an adult: (azimuth about the vertical axis through z = -6, degrees, 0 at the
#: front; height y, cm). Hair grows above it.
_HAIRLINE = np.array(
    [
        *((0, 7.6), (25, 7.9), (42, 7.4), (60, 4.6), (72, 1.5), (80, -1.0), (88, 0.6)),
        *((100, 1.4), (115, 0.0), (128, -4.5), (180, -7.5)),
    ],
    dtype=float,
)


@dataclass(frozen=True)
class Strands:
    """points: (N, K, 3) along each strand, root first. radius: (N,) at the root, cm."""

    points: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True)
class Style:
    """How hair falls.

    length, cm; lift: share of the surface's normal in the first direction; comb: the other share;
    part: x of a parting from which hair goes to both sides, or None; fall: pull of gravity per cm;
    curl: radius of the locks' spirals, cm, and turns per cm; clump: how far strands follow their
    lock, 0 to 1; wild: randomness of directions; count of strands; recede: how far the hairline
    lies above the usual one, cm; bald: whether the crown has no hair; fringe: length of what
    grows near the forehead, cm, and falls over it, or None; sweep: how far to one side, at most,
    beside .9 forwards.
    """

    length: float
    lift: float = 0.4
    comb: tuple[float, float, float] = (0.0, 0.2, -1.0)
    part: float | None = None
    fall: float = 0.05
    curl: tuple[float, float] = (0.0, 0.0)
    clump: float = 0.5
    wild: float = 0.15
    count: int = 14_000
    recede: float = 0.0
    bald: bool = False
    fringe: float | None = None
    sweep: float = 0.6


STYLES = {
    "buzz": Style(0.7, lift=0.8, clump=0.0, wild=0.2, count=24_000),
    "short": Style(3.5, lift=0.5, comb=(0.2, 0.4, -0.6), wild=0.25, count=16_000),
    "swept": Style(7.0, lift=0.6, comb=(0.5, 0.3, -0.8), fall=0.02),
    "spiky": Style(3.0, lift=0.9, comb=(0.0, 0.6, 0.2), wild=0.3, clump=0.8),
    "receding": Style(2.5, lift=0.4, recede=1.6, wild=0.25),
    "crown": Style(2.0, lift=0.4, bald=True, wild=0.3),
    "tied": Style(10.0, lift=0.06, comb=(0.0, 0.4, -1.0), fall=0.0, clump=0.7, wild=0.03),
    "bob": Style(17.0, lift=0.25, comb=(0.0, 0.0, -0.4), part=0.0, fall=0.5, clump=0.6),
    "long": Style(32.0, lift=0.2, comb=(0.0, 0.0, -0.35), part=0.0, fall=0.5, clump=0.7),
    "wavy": Style(26.0, 0.25, (0.0, 0.0, -0.35), 0.0, 0.4, (0.5, 0.12), 0.8, 0.2),
    "curly": Style(9.0, 0.7, (0.0, 0.1, -0.2), None, 0.06, (0.55, 0.35), 0.9, 0.35),
    "afro": Style(7.0, 1.0, (0.0, 0.1, 0.0), None, 0.0, (0.35, 0.9), 0.4, 0.35, 22_000),
    "fringe": Style(24.0, 0.25, (0.0, 0.0, -0.35), None, 0.5, clump=0.6, fringe=9.0),
    "short fringe": Style(5.0, 0.3, (0.1, 0.1, -0.3), None, 0.5, clump=0.6, fringe=9.0),
    "side fringe": Style(
        24.0, 0.25, (0.0, 0.0, -0.35), None, 0.5, clump=0.3, wild=0.05, fringe=12.0, sweep=2.0
    ),
}


def hair(head: Head, style: Style, rng: np.random.Generator) -> Strands:
    """Hair of the head in that style."""
    style = _varied(style, rng)
    roots, normals = _scatter(head, _scalp_density(head, style, rng), style.count, rng)
    length = style.length * rng.uniform(0.75, 1.05, len(roots))
    part = (style.part or 0.0) + rng.uniform(-2.5, 2.5)
    to_side = np.zeros_like(roots)
    if style.part is not None:
        to_side[:, 0] = np.tanh((roots[:, 0] - part) / 0.3)
    direction = style.lift * normals + (1 - style.lift) * (to_side + np.array(style.comb))
    if style.fringe is not None:
        front = _azimuth(roots) < rng.uniform(35, 60)
        front &= (roots[:, 2] > -6.0) & (roots[:, 1] > 4.0)
        length[front] = style.fringe * rng.uniform(0.85, 1.0, front.sum())
        forward = np.array([rng.uniform(-style.sweep, style.sweep), 0.15, 0.9])
        direction[front] = 0.3 * normals[front] + 0.7 * forward
    return _grow(head, roots, direction, length, style, rng, radius=rng.uniform(0.018, 0.035))


def loose_strands(head: Head, rng: np.random.Generator) -> Strands:
    """A few strands that have come loose at the hairline and lie across forehead and cheeks."""
    style = Style(rng.uniform(6, 16), lift=0.5, fall=0.16, clump=0.85, wild=0.25)
    density = _scalp_density(head, style, rng)
    low = _scalp_density(head, replace(style, recede=1.5), rng)
    rim = np.maximum(density - low, 0) * (_azimuth(head.vertices) < 85)
    roots, normals = _scatter(head, rim, int(rng.integers(20, 260)), rng, locks=7)
    direction = 0.5 * normals + np.array([rng.uniform(-0.4, 0.4), 0.1, 0.4])
    length = style.length * rng.uniform(0.4, 1.0, len(roots))
    return _grow(head, roots, direction, length, style, rng, radius=0.018)


def brows(head: Head, rng: np.random.Generator) -> Strands:
    """Both eyebrows, of random density."""
    density = np.zeros(len(head.vertices))
    front = head.vertices[:, 2] > -2
    for contour in (RIGHT_EYEBROW, LEFT_EYEBROW):
        polygon = head.landmarks[list(contour)][:, :2]
        density[front & _inside(polygon, head.vertices[:, :2], 0.12)] = 1
    count = int(rng.choice([250, 700, 1500, 2500]))
    roots, normals = _scatter(head, density, count, rng)
    outwards = np.sign(roots[:, :1]) * np.array([1.0, 0.0, -0.35])
    rise = np.clip(0.9 - 0.35 * (np.abs(roots[:, :1]) - 1.2), -0.5, 0.9) * np.array([0, 1.0, 0])
    style = Style(0.9, fall=0.0, clump=0.15, wild=0.2)
    direction = 0.25 * normals + outwards + rise
    length = rng.uniform(0.4, 1.0, len(roots))
    return _grow(head, roots, direction, length, style, rng, radius=0.018)


@dataclass(frozen=True)
class Beard:
    """length, cm; count of hairs; cheeks: whether it grows on chin and cheeks, too; patchy: how
    uneven its growth may be, 0 to 1; radius of a hair, cm.
    """

    length: float
    count: int
    cheeks: bool = True
    patchy: float = 0.5
    radius: float = 0.014


#: All with a moustache. A man's beard has some 40 hairs a square centimetre, 0.01 cm thick.
BEARDS = {
    "stubble": Beard(0.15, 14_000, radius=0.008),
    "short": Beard(0.8, 36_000, radius=0.012),
    "full": Beard(3.5, 20_000, patchy=0.3),
    "long": Beard(8.0, 16_000, patchy=0.3),
    "moustache": Beard(0.9, 4_000, cheeks=False),
    "goatee": Beard(1.2, 5_000, cheeks=False),
}


def beard(head: Head, kind: str, rng: np.random.Generator) -> dict[str, list[Strands]]:
    """A beard, as what it counts as: 'stubble' or 'beard'; kind: a name in BEARDS."""
    usual = BEARDS[kind]
    length = usual.length * np.exp(rng.uniform(-0.4, 0.4))
    density = _beard_density(head, kind, rng)
    patchy = usual.patchy * rng.random()
    density *= 1 - patchy * (1 - noise(head.vertices, 1.5, rng) ** 2)
    roots, normals = _scatter(head, density, int(usual.count * rng.uniform(0.7, 1.3)), rng)
    down = np.array([0.0, -1.0, 0.25]) + np.sign(roots[:, :1]) * np.array([0.25, 0, 0])
    curl = (rng.uniform(0, 0.15), 0.6)
    style = Style(length, fall=0.35, clump=rng.uniform(0, 0.4), wild=0.25, curl=curl)
    direction = rng.uniform(0.1, 0.4) * normals + 0.7 * down
    lengths = length * rng.uniform(0.5, 1.0, len(roots))
    grown = _grow(head, roots, direction, lengths, style, rng, usual.radius)
    return {"stubble" if kind == "stubble" else "beard": [grown]}


def _beard_density(head: Head, kind: str, rng: np.random.Generator) -> np.ndarray:
    """Density of roots at the vertices (V,), 0 to 1: soft where a beard thins out."""
    v, lm = head.vertices, head.landmarks
    nose, top_lip, low_lip, chin = lm[2], lm[0], lm[17], lm[152]
    corner = np.abs(lm[[61, 291], 0]).mean()
    mouth = lm[[61, 291], 1].mean()
    x, y, z = v.T
    soft = rng.uniform(0.1, 0.8)  # cm from no beard to all of it
    line = (
        mouth + rng.uniform(-0.5, 1.2) + np.maximum(np.abs(x) - corner, 0) * rng.uniform(0.4, 0.9)
    )
    jaw = _ramp(line - y, soft) * _ramp(y - (chin[1] - rng.uniform(0.5, 3.0)), soft)
    lip = _ramp(corner + 0.5 - np.abs(x), soft) * ((y < nose[1] - 0.15) & (y > top_lip[1] - 0.7))
    if BEARDS[kind].cheeks:
        azimuth = _azimuth(v)
        sideburn = _ramp(azimuth - 60, 8 * soft) * _ramp(84 - azimuth, 8 * soft)
        jaw = np.maximum(jaw, sideburn * ((y < 1) & (y > chin[1])))
    else:
        chin_only = (np.abs(x) < rng.uniform(1.0, 1.6)) & (y < low_lip[1] - 0.2)
        jaw = jaw * (chin_only & (kind == "goatee"))
    if kind == "goatee":
        ring = (np.abs(np.abs(x) - corner - 0.3) < 0.45) & (y < mouth + 0.4) & (y > chin[1])
        lip = np.maximum(lip, ring)
    lips = KDTree(v[head.within("lips")])
    clear = lips.query(v)[0] > rng.uniform(0.1, 0.25)
    outside = (z > -9) & (head.normals[:, 2] > -0.6)
    return np.maximum(jaw, lip) * (head.within("skin", "neck") & clear & outside)


def _ramp(depth: np.ndarray, width: float) -> np.ndarray:
    """0 outside, 1 from `width` inside on."""
    return np.clip(depth / width, 0, 1)


def below(strands: Strands, clothes: list[np.ndarray]) -> Strands:
    """Those strands that do not grow under a hat; clothes: the vertices (V, 3) of its meshes."""
    if not clothes or not len(strands.points):
        return strands
    covered = KDTree(np.concatenate(clothes)).query(strands.points[:, 0])[0] < 1.8
    return Strands(strands.points[~covered], strands.radius[~covered])


def _varied(style: Style, rng: np.random.Generator) -> Style:
    return replace(
        style,
        length=style.length * rng.uniform(0.75, 1.3),
        fall=style.fall * rng.uniform(0.8, 1.2),
        recede=style.recede + rng.normal() * 0.5,
        clump=min(style.clump * rng.uniform(0.7, 1.3), 0.95),
        wild=style.wild * rng.uniform(0.6, 1.5),
    )


def _azimuth(points: np.ndarray) -> np.ndarray:
    """Degrees about the vertical axis of the skull: 0 at the front, 180 at the back."""
    return np.degrees(np.arctan2(np.abs(points[:, 0]), points[:, 2] + 6.0))


def _scalp_density(head: Head, style: Style, rng: np.random.Generator) -> np.ndarray:
    """Density of roots at the vertices (V,), 0 to 1: soft at the hairline."""
    v = head.vertices
    azimuth = _azimuth(v)
    # The line is that of the mean head; this head's forehead may be higher or lower.
    raise_ = 0.5 * (head.landmarks[10, 1] - 5.13)
    line = np.interp(azimuth, *_HAIRLINE.T)
    line = line + (style.recede + raise_) * np.clip(1.2 - azimuth / 60, 0, 1)
    line = line + 0.5 * (noise(v, 1.2, rng) - 0.5)
    density = _ramp(v[:, 1] - line, 0.5)
    if style.bald:
        density *= (azimuth > 55) & (v[:, 1] < 7.5)
    near_ear = KDTree(v[head.within("ears")]).query(v)[0] < 0.4
    return density * (head.outer() & ~near_ear)


def _scatter(
    head: Head, density: np.ndarray, count: int, rng: np.random.Generator, locks: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Random roots (N, 3) and their normals, as dense as `density` (V,) says.

    locks: of the roots, how many places they gather at; 0: none.
    """
    corners = head.vertices[head.triangles]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    weight = area * density[head.triangles].mean(axis=1)
    if weight.sum() <= 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    if locks:
        chosen = rng.choice(len(weight), locks, p=weight / weight.sum())
        middle = corners.mean(axis=1)
        near = KDTree(middle[chosen]).query(middle)[0]
        weight = weight * np.exp(-((near / 0.35) ** 2))
    triangle = rng.choice(len(weight), count, p=weight / weight.sum())
    b = rng.dirichlet((1, 1, 1), count)[..., None]
    normals = head.normals[head.triangles[triangle]]
    normal = (normals * b).sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return (corners[triangle] * b).sum(axis=1), normal


def _grow(
    head: Head,
    roots: np.ndarray,
    direction: np.ndarray,
    length: np.ndarray,
    style: Style,
    rng: np.random.Generator,
    radius: float,
) -> Strands:
    """Strands that leave `roots` in `direction` (N, 3), are bent by gravity and slide over skin."""
    count = len(roots)
    if not count:
        return Strands(np.zeros((0, _POINTS, 3)), np.zeros(0))
    tree, normals = KDTree(head.vertices), head.normals
    step = (length / (_POINTS - 1))[:, None]
    d = direction + style.wild * rng.standard_normal(direction.shape)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    place, points = roots - 0.05 * d, []
    for _ in range(_POINTS):
        points.append(place)
        d = d + step * style.fall * np.array([0.0, -1.0, 0.0])
        d += 0.3 * style.wild * rng.standard_normal(d.shape) * np.sqrt(step / 2)
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        ahead = place + step * d
        distance, nearest = tree.query(ahead)
        n = normals[nearest]
        height = np.einsum("ij,ij->i", ahead - head.vertices[nearest], n)
        # Between two points the strand is straight and the head is not.
        clear = _CLEARANCE + step[:, 0] ** 2 / 25
        sunk = np.where(distance < 3.0, np.maximum(clear - height, 0), 0)[:, None]
        ahead = ahead + sunk * n
        moved = ahead - place
        d = moved / np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), 1e-6)
        place = place + step * d
        place = np.where(sunk > 0, ahead, place)
    strands = np.stack(points, axis=1)
    strands = _gathered(strands, roots, style, rng)
    return Strands(strands, np.full(count, radius))


def _gathered(
    strands: np.ndarray, roots: np.ndarray, style: Style, rng: np.random.Generator
) -> np.ndarray:
    """Strands drawn to the middle of their lock, more so at the tips, and curled with it."""
    guides = rng.choice(len(roots), max(len(roots) // 60, 1), replace=False)
    lock = KDTree(roots[guides]).query(roots)[1]
    along = np.linspace(0, 1, strands.shape[1])[None, :, None]
    guide = strands[guides][lock]
    strands = strands + style.clump * np.clip(1.6 * along - 0.2, 0, 1) * (guide - strands)
    radius, turns = style.curl
    if radius > 0:
        arc = np.linalg.norm(np.diff(guide, axis=1), axis=2).cumsum(axis=1)
        arc = np.concatenate([np.zeros((len(arc), 1)), arc], axis=1)
        phase = rng.uniform(0, 2 * np.pi, len(guides))[lock][:, None]
        spin = 2 * np.pi * turns * arc + phase
        grown = np.clip(4 * along, 0, 1)
        across = np.stack([np.cos(spin), 0.3 * np.sin(2 * spin), np.sin(spin)], axis=2)
        strands = strands + radius * grown * across
    return strands


def noise(points: np.ndarray, wavelength: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth random values in [0, 1] at `points` (N, 3)."""
    waves = rng.standard_normal((24, 3)) * (2 * np.pi / wavelength / 2)
    total = np.sin(points @ waves.T + rng.uniform(0, 2 * np.pi, 24)).sum(axis=1)
    return 0.5 + 0.5 * np.tanh(total / 4)


def _inside(polygon: np.ndarray, points: np.ndarray, margin: float) -> np.ndarray:
    """(N,) bool: within `margin` of a polygon (M, 2) or in it; points: (N, 2)."""
    contour = polygon.astype(np.float32).reshape(-1, 1, 2)
    near = np.flatnonzero((np.abs(points - polygon.mean(axis=0)) < 6).all(axis=1))
    found = np.zeros(len(points), bool)
    for k in near:
        x, y = (float(value) for value in points[k])
        found[k] = cv2.pointPolygonTest(contour, (x, y), True) > -margin
    return found
