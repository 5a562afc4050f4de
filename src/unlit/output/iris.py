"""The texture of an eye, completed: a whole iris, a whole white, and no reflections in either.

In polar coordinates about the eye's axis, t being the angle over that of the iris' rim:

- the iris and its pupil are round: what lids, lashes or a reflection hide of a ring is taken from
  the rest of the ring, from near it and from its mirror image;
- a reflection (catch-light) is what is much brighter than its ring, with a rim around it;
- the white goes on as the white that is seen, without what is as dark as lashes or a lid's shadow;
- of eyes that nothing is known of, as behind dark glasses, the iris is drawn in a dark greyish
  brown, the most common colour: a guess, and marked as one, but no blank ball.

An eyeball is smooth: relief that the photo's reflections feign is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ..color import luminance
from .evidence import ramp
from .eyes import Eye
from .geometry import Welded
from .photo_samples import LOGS
from .texels import Texels

#: The iris, of the angle of its rim; its middle, where the pupil
#: is; width of a ring.
_IRIS, _MIDDLE, _RING = 1.0, 0.4, 0.1
#: Where iris fades into white, of that angle.
_EDGE = (0.88, 1.12)
#: Log luminance over the ring's at which something is a reflection, and under it a lash or a
#: shadow. How far around a reflection its blur goes.
_BRIGHT, _DARK, _BLUR = 0.35, 0.8, 0.16
#: Of what surrounds irises, the percentile of blue from which it is white; red over blue (log) at
#: which it is skin; and how far, in brightness and in tint (log), white is from the typical one.
_BLUEST, _REDDEST, _WHITE_OFF, _TINT = 60, 0.7, 0.4, 0.12
#: Log luminance that no white of an eye has more of: in photos it is soon overexposed.
_BRIGHTEST = float(np.log(0.7))
#: Share of the iris, and number of texels of the white, that have to be seen to go by.
_LEAST, _WHITE = 0.15, 12
#: Neighbours that a texel is made of; how much farther what lies across the ring is than what lies
#: along it, and how far the mirror image is. What the white's typical tone weighs.
_NEIGHBOURS, _ACROSS, _MIRROR, _TONE = 16, 5.0, 0.4, 0.15
#: Log values of an iris that no photo shows, of its rim and of its pupil; the pupil's radius, of
#: the iris'.
_GUESS, _RIM, _PUPIL = np.log(
    [[0.075, 0.048, 0.033, 0.7, 0.15], [0.03, 0.022, 0.018, 0.7, 0.15], [0.006] * 3 + [0.7, 0.15]]
)
_PUPIL_SIZE = 0.36
_PLAIN, _DIFFUSED, _MIRRORED = 0, 64, 128


def complete_eyes(
    eyes: Sequence[Eye], mesh: Welded, texels: Texels, values: np.ndarray, level: np.ndarray
) -> None:
    """Complete the texels of the eyes in place.

    values: (N * N, CHANNELS) of the atlas (photo_samples.py). level: (N * N,) their confidence.
    """
    looks = [_Look.of(eye, mesh, texels, values, level) for eye in eyes]
    white = _white([look.logs[look.seen & ~look.iris] for look in looks])
    hidden = not any(look.shows_iris for look in looks)
    for look in looks:
        index, t, logs, seen, iris = look.index, look.t, look.logs, look.seen, look.iris
        values[index, LOGS.stop :] = 0
        edge = np.abs(t - 0.5 * sum(_EDGE)) < 0.5 * (_EDGE[1] - _EDGE[0])
        inner, outer = logs.copy(), logs.copy()
        shown = look.shows_iris
        if hidden:
            inner = _guessed(t)
            level[index[iris]] = _PLAIN
        if shown:
            good = seen & ~_strange(t, look.around, _bright(logs), seen & iris)
            fill = edge | (iris & ~good)
            inner[fill] = _round(t, look.around, logs, good & iris & ~edge, fill)
            level[index[iris & ~good]] = _MIRRORED
        if white is not None:
            good = seen & ~iris & _is_white(logs, white)
            dimmer = white + np.r_[np.full(3, min(_BRIGHTEST - _bright(white[None])[0], 0)), 0, 0]
            outer[good] += dimmer - white
            fill = edge | (~iris & ~good)
            outer[fill] = _spread(look.unit, outer, good & ~edge, fill, dimmer)
            level[index[~iris & ~good]] = _DIFFUSED
        round_ = hidden or (shown and white is not None)
        share = ramp(t, *_EDGE) if round_ else (~iris).astype(float)
        values[index, LOGS] = (1 - share[:, None]) * inner + share[:, None] * outer


@dataclass(frozen=True)
class _Look:
    """The K texels of an eye: numbers, directions from its middle (K, 3), polar coordinates about
    its axis, log values (K, 5), and whether the photo shows them or they are of the iris."""

    index: np.ndarray
    unit: np.ndarray
    t: np.ndarray
    around: np.ndarray
    logs: np.ndarray
    seen: np.ndarray
    iris: np.ndarray

    @property
    def shows_iris(self) -> bool:
        """Whether there is enough of the iris to go by."""
        return bool((self.seen & self.iris).sum() > _LEAST * self.iris.sum())

    @staticmethod
    def of(eye: Eye, mesh: Welded, texels: Texels, values: np.ndarray, level: np.ndarray) -> _Look:
        some = texels.some(eye.vertices[mesh.vertex[mesh.triangles[texels.triangle, 0]]])
        arm = some.at(mesh.position, mesh.triangles) - eye.centre
        unit = arm / np.linalg.norm(arm, axis=1, keepdims=True)
        across = np.cross((0.0, 1.0, 0.0), eye.axis)
        across /= np.linalg.norm(across)
        up = np.cross(eye.axis, across)
        t = np.arccos(np.clip(unit @ eye.axis, -1, 1)) / eye.rim
        around = np.arctan2(unit @ up, unit @ across)
        seen = level[some.index] >= _MIRRORED
        return _Look(some.index, unit, t, around, values[some.index, LOGS], seen, t < _IRIS)


def _guessed(t: np.ndarray) -> np.ndarray:
    """Log values (K, 5) of an iris that no photo shows."""
    rim = ramp(t, 0.75, 1.0)[:, None]
    pupil = 1 - ramp(t, _PUPIL_SIZE - 0.05, _PUPIL_SIZE + 0.05)[:, None]
    outer = _GUESS + rim * (_RIM - _GUESS)
    return outer + pupil * (_PUPIL - outer)


def _bright(logs: np.ndarray) -> np.ndarray:
    """Log luminance (K,)."""
    return np.log(np.maximum(luminance(np.exp(logs[:, :3])), 1e-6))


def _white(seen: Sequence[np.ndarray]) -> np.ndarray | None:
    """Typical log values (5,) of the whites of both eyes; None where the photo shows too little.

    seen: of each eye, log values (K, 5) around the iris, rims of lids and lashes among them: of
    all that, white is what has most blue.
    """
    logs = np.concatenate(seen) if seen else np.zeros((0, 5))
    if len(logs) < _WHITE:
        return None
    white = np.median(logs[logs[:, 2] >= np.percentile(logs[:, 2], _BLUEST)], axis=0)
    return white if white[0] - white[2] < _REDDEST else None


def _is_white(logs: np.ndarray, white: np.ndarray) -> np.ndarray:
    """(K,) bool: about as bright as the white and of its colour."""
    off = logs[:, :3] - white[:3]
    tint = off - off.mean(axis=1, keepdims=True)
    return (np.abs(off.mean(axis=1)) < _WHITE_OFF) & (np.abs(tint).max(axis=1) < _TINT)


def _strange(t: np.ndarray, around: np.ndarray, bright: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(K,) bool: reflections on the iris with their blur, and what is far too dark for it."""
    usual = float(np.median(bright[seen & (t > 0.5) & (t < 0.9)])) if seen.any() else 0.0
    ring = np.minimum((t / _RING).astype(int), int(_IRIS / _RING))
    level = np.full(ring.max() + 1, usual)
    for number in np.unique(ring[seen]):
        here = bright[seen & (ring == number)]
        # A reflection may cover most of the pupil, which is not brighter than the iris.
        middle = (number + 0.5) * _RING < _MIDDLE
        found = np.percentile(here, 25 if middle else 40)
        level[number] = min(found, usual) if middle else found
    over = bright - np.interp(t, (np.arange(len(level)) + 0.5) * _RING, level)
    reflection = seen & (over > _BRIGHT)
    strange = seen & (over < -_DARK)
    if reflection.any():
        disc = t[:, None] * np.stack([np.cos(around), np.sin(around)], axis=1)
        distance = KDTree(disc[reflection]).query(disc, distance_upper_bound=_BLUR)[0]
        strange |= np.isfinite(distance)
    return strange


def _round(
    t: np.ndarray, around: np.ndarray, logs: np.ndarray, good: np.ndarray, fill: np.ndarray
) -> np.ndarray:
    """Values of the texels `fill` (K,) of the iris from the rest of their rings."""

    def places(mirrored: bool) -> np.ndarray:
        angle = np.pi - around if mirrored else around
        width = np.minimum(t, 1.0)  # of a ring near the middle all is near
        away = np.full(len(t), _MIRROR if mirrored else 0.0)
        return np.stack([_ACROSS * t, width * np.cos(angle), width * np.sin(angle), away], axis=1)

    sources = np.concatenate([places(False)[good], places(True)[good]])
    found = np.concatenate([logs[good], logs[good]])
    return _nearest(sources, found, places(False)[fill])[0]


def _spread(
    unit: np.ndarray, logs: np.ndarray, good: np.ndarray, fill: np.ndarray, white: np.ndarray
) -> np.ndarray:
    """Values of the texels `fill` (K,) of the white: of what is near, far away the typical one."""
    if not good.any():
        return np.broadcast_to(white, logs[fill].shape)
    near, weight = _nearest(unit[good], logs[good], unit[fill])
    share = (weight / (weight + _NEIGHBOURS / _TONE))[:, None]
    return share * near + (1 - share) * white


def _nearest(
    sources: np.ndarray, values: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (K, C) of `values` (M, C) at the `sources` nearest to `places` (K, D); its weight."""
    count = min(_NEIGHBOURS, len(sources))
    distance, number = KDTree(sources).query(places, k=count)
    distance, number = (np.reshape(found, (len(places), count)) for found in (distance, number))
    weight = 1 / (0.02 + distance)
    total = weight.sum(axis=1)
    mean = (weight[..., None] * values[number]).sum(axis=1) / total[:, None]
    return mean, total
