"""A thick, well-kept fringe painted over the forehead of a rendered head.

Strands that are grown one by one let the forehead show between them. A real fringe often does not,
and its lower edge is as clean as a hairline: a network that has seen only the former takes it for a
forehead. Its colour is that of the head's own hair in the render.
"""

from __future__ import annotations

import cv2
import numpy as np

from unlit.perception.measures import smoothstep, upwards
from unlit.perception.parser import CLASSES
from unlit.perception.topology import CHIN, HAIRLINE, LEFT_EYEBROW, RIGHT_EYEBROW

_SKIN, _BROWS, _HAIR = (CLASSES.index(name) for name in ("skin", "eyebrows", "hair"))
_LEAST = 300  # pixels of hair that say what colour it has


def painted_fringe(
    linear: np.ndarray, shares: np.ndarray, landmarks: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The render and its shares with a fringe; both unchanged where the head has little hair.

    linear: (S, S, 3) float32. shares: (S, S, 13) uint8, 255 is all. landmarks: (478, 2), pixels.
    """
    sure = shares[..., _HAIR] > 200
    if sure.sum() < _LEAST:
        return linear, shares
    across, above = _forehead(landmarks, len(linear))
    edge = rng.uniform(-0.15, 0.8) + rng.uniform(-0.5, 0.5) * across
    edge += rng.uniform(-0.6, 0.3) * across**2 + _ragged(across, rng)
    reach = rng.uniform(0.9, 1.5)
    where = smoothstep(above - edge, 0, rng.choice([0.02, 0.06, 0.15]))
    where *= 1 - smoothstep(np.abs(across), reach, reach + 0.2)
    body = shares[..., [_SKIN, _BROWS, _HAIR]].sum(axis=-1, dtype=np.float32) / 255
    where = (where * body).astype(np.float32)[..., None]
    shadow = rng.uniform(0, 0.5) * np.exp(-np.maximum(edge - above, 0) / rng.uniform(0.05, 0.3))
    result = linear * (1 - body * shadow)[..., None]
    result += where * (_hair(linear, sure, across, above, rng) - result)
    skin, brows = (shares[..., k] * (1 - where[..., 0]) for k in (_SKIN, _BROWS))
    covered = shares.copy()
    covered[..., _HAIR] += np.round(shares[..., _SKIN] - skin + shares[..., _BROWS] - brows).astype(
        np.uint8
    )
    covered[..., _SKIN], covered[..., _BROWS] = np.round(skin), np.round(brows)
    return result.astype(np.float32), covered


def _forehead(landmarks: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """(S, S) each: -1 to 1 from brow's end to brow's end, and 0 to 1 from the brows to the hair."""
    up = upwards(landmarks)
    brows = landmarks[[*RIGHT_EYEBROW, *LEFT_EYEBROW]]
    middle = brows.mean(axis=0)
    right = np.array([-up[1], up[0]])
    wide = np.abs((brows - middle) @ right).max()
    # A turned head's hairline is seen from the side, its chin is as far from the brows.
    high = max((landmarks[HAIRLINE] - middle) @ up, 0.45 * ((middle - landmarks[CHIN]) @ up))
    rows, columns = np.indices((size, size)) + 0.5
    offset = np.stack([columns, rows], axis=-1) - middle
    return offset @ right / wide, offset @ up / high


def _ragged(across: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(S, S): tips of locks along the edge."""
    return rng.choice([0.0, 0.03, 0.1]) * _waves(across, rng.uniform(4, 25), rng)


def _hair(
    linear: np.ndarray,
    sure: np.ndarray,
    across: np.ndarray,
    above: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """(S, S, 3): hair of the head's colour, combed one way, in the light that falls there."""
    colour = np.median(linear[sure], axis=0) * np.exp(rng.uniform(-0.2, 0.6))
    smooth = cv2.GaussianBlur(linear.mean(axis=-1), (0, 0), len(linear) / 15)
    light = np.clip(smooth / max(float(np.median(smooth[sure])), 1e-6), 0.3, 2) ** 0.5
    sweep, bend = rng.uniform(-1.5, 1.5), rng.uniform(-0.8, 0.8)
    strand = across + sweep * (above + bend * above**2) + 0.1 * _waves(above, 2.0, rng)
    streaks = sum(_waves(strand, frequency, rng) for frequency in (6, 15, 40))
    ring = rng.uniform(0, 1.0) * np.exp(-(((above - rng.uniform(0, 1)) / 0.25) ** 2))
    tone = rng.uniform(0.05, 0.35) * streaks + ring
    return colour * (light * np.exp(tone))[..., None]


def _waves(along: np.ndarray, frequency: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth random values of about 1 that change `frequency` times a unit; `along`: any shape."""
    knots = rng.standard_normal(max(int(16 * frequency), 8))
    place = (np.clip(along, -4, 4) + 4) / 8 * (len(knots) - 1)
    return np.interp(place.ravel(), np.arange(len(knots)), knots).reshape(along.shape)
