"""Light whose colour changes over the face, told by the face's two halves.

Skin has one chromaticity left and right, but in photos the shaded half is often redder, greyer or
greener: by a second lamp, by a camera's tone curve, which raises saturation in the shade, by toning
in an editor. All of it follows the brightness of the photo closely. With c = (ln R/G, ln B/G) of
the photo without gloss, at a point x and its mirror image x',

    c(x) - c(x') = f(v(x), n(x)) - f(v(x'), n(x')),    f = curve(v) + t . n,

with v the log brightness and n the normal; curve is piecewise linear. f is found by robust least
squares over all pairs, without any word on what colour skin has. What f says of the halves'
difference is taken out of the photo, and of what it says of both alike only a share, since there
pigment may be dark, too. The whole is drawn back as a Wiener filter would, by
1 - (least^2 + rest^2) / difference^2: heads whose light has one colour leave a difference, too, and
what f leaves is more likely pigment, as of painted faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from ..color import luminance
from ..face.gain import AlbedoGain
from ..optimize.observation import Observation
from ..optimize.problem import Problem
from ..progress.callbacks import silent
from ..scene.maps import fill
from ..settings.settings import Settings
from ..settings.tint import TintSearch
from .first_stage import short_stage1
from .halves import Halves

#: Side at which it is looked for; the settings' lengths are pixels of it.
_SIZE = 256
#: Darker values, linear, are taken for this; darker or brighter pixels are left out.
_BLACK, _DARK, _SATURATED = 0.002, 0.004, 0.95
#: Most of a pixel that gloss is taken to be.
_MOST_GLOSS = 0.75
#: What the curve's bend, its departure from 0 and t cost, against a squared difference of 1.
_BENT, _ANY, _TURNED = 0.0225, 2e-5, 4.5e-3
#: Turns of the robust fit.
_TURNS = 8


def tint(observation: Observation, across: np.ndarray, settings: Settings) -> np.ndarray | None:
    """(S, S, 3) float32 > 0: what the photo's colour is of what even light would leave.

    across: (3,) unit, world frame, roughly across the face. Of luminance 1 for the skin's median
    colour. None where the halves' colours agree, or too little of both is seen.
    """
    how = settings.tint
    small = observation.reduced(_SIZE)
    try:
        problem = Problem(small, settings, AlbedoGain(), silent)
    except ValueError:  # the head and the mask do not overlap: `solve` says so
        return None
    halves = Halves.of(problem, across)
    plain = _plain(problem)
    whole = _Colours.of(problem, halves, small.image, plain, how)
    # With gloss in it, which is white and stronger on one half, the difference is larger.
    if whole is None or not whole.strength(how.least):
        return None
    stage1 = short_stage1(small, replace(settings, bounces=0))
    gloss = settings.nominal_specular * stage1.specular_shading
    bright = np.maximum(small.image.mean(axis=2), _BLACK)
    diffuse = np.maximum(small.image - gloss[..., None], (1 - _MOST_GLOSS) * small.image)
    plain &= gloss / bright < how.glossy
    colours = _Colours.of(problem, halves, diffuse, plain, how)
    if colours is None:
        return None
    strength = colours.strength(how.least)
    if not strength:
        return None
    shift = strength * _over_face(problem, colours, plain, how)
    found = np.exp(np.dstack([shift[..., 0], np.zeros_like(shift[..., 0]), shift[..., 1]]))
    skin = np.median(diffuse[plain], axis=0)
    found = (found * (luminance(skin) / luminance(found * skin))[..., None]).astype(np.float32)
    size = observation.camera.width
    if size == len(found):
        return found
    return np.exp(cv2.resize(np.log(found), (size, size), interpolation=cv2.INTER_LINEAR))


def _plain(problem: Problem) -> np.ndarray:
    """(S, S) bool: skin away from brows, eyes and lips, neither black nor saturated."""
    seen = problem.observation
    features = ndimage.gaussian_filter(seen.regions[..., 1:].sum(axis=2), 2.0)
    plain = (seen.regions[..., 0] > 0.9) & (features < 0.05) & problem.fitted
    inner: Any = ndimage.binary_erosion(plain, iterations=2)
    saturated = ndimage.maximum_filter(seen.image.max(axis=2), 5) > _SATURATED
    dark = ndimage.gaussian_filter(seen.image.mean(axis=2), 1.5) < _DARK
    return inner & ~saturated & ~dark & (seen.weight > 0.9)


@dataclass(frozen=True)
class _Colours:
    """colour: (P, 2) ln R/G, ln B/G. basis: (P, K + 3) of f; factors: (K + 3, 2). usable: (P,)
    bool; twin: (P,), the pixel of the mirror image, -1 where it is not usable. one: (N,) pixels
    that were held against their twin, with weights (N,).
    """

    colour: np.ndarray
    basis: np.ndarray
    factors: np.ndarray
    usable: np.ndarray
    twin: np.ndarray
    one: np.ndarray
    weights: np.ndarray

    @staticmethod
    def of(
        problem: Problem, halves: Halves, image: np.ndarray, plain: np.ndarray, how: TintSearch
    ) -> _Colours | None:
        """Of `image` (S, S, 3), linear; None with too few pairs."""
        usable = problem.rows(plain)
        paired = usable & usable[halves.twin] & (halves.apart < how.apart)
        one = np.flatnonzero(paired & (np.abs(halves.beside) > how.beside))
        if len(one) < how.pairs:
            return None
        twin = np.where(paired, halves.twin, -1)
        other = twin[one]
        logs = problem.rows(_smooth_log(image, plain, how.blur))
        value = problem.rows(_smooth_log(problem.observation.image, plain, how.blur)).mean(axis=1)
        colour = logs[:, [0, 2]] - logs[:, [1]]
        low, high = np.percentile(value[np.concatenate([one, other])], (2, 98))
        basis = np.hstack([_hats(value, np.linspace(low, high, how.knots)), halves.normal])
        factors, weights = _fit(basis[one] - basis[other], colour[one] - colour[other], how)
        return _Colours(colour, basis, factors, usable, twin, one, weights)

    def strength(self, least: float) -> float:
        """How far f is to be believed, in [0, 1]."""
        twin = self.twin[self.one]
        apart = self.colour[self.one] - self.colour[twin]
        rest = apart - (self.basis[self.one] - self.basis[twin]) @ self.factors
        # The weights leave out make-up and moles on one side.
        whole, left = (np.average((x**2).mean(axis=1), weights=self.weights) for x in (apart, rest))
        return float(max(0, 1 - (least**2 + left) / max(whole, 1e-12)))

    def shift(self) -> np.ndarray:
        """f, (P, 2), mean 0 over the usable pixels."""
        found = self.basis @ self.factors
        return np.asarray(found - found[self.usable].mean(axis=0))


def _over_face(
    problem: Problem, colours: _Colours, plain: np.ndarray, how: TintSearch
) -> np.ndarray:
    """(S, S, 2): what is taken out of ln R/G and ln B/G; brows, eyes and lips as around them."""
    shift = colours.shift()
    # Where the mirror image is not seen, that half is taken for the mean, 0.
    other = np.where(colours.twin[:, None] < 0, 0, shift[colours.twin])
    out = (shift - other) / 2 + how.symmetric * (shift + other) / 2
    known = plain & problem.inside
    filled = fill(problem.image_of(out), known)
    near, wide = (_blurred(filled, reach) for reach in (how.blur, how.wide))
    share = np.clip(ndimage.gaussian_filter(known.astype(np.float32), how.blur) / 0.3, 0, 1)
    return np.asarray(share[..., None] * near + (1 - share[..., None]) * wide)


def _fit(basis: np.ndarray, apart: np.ndarray, how: TintSearch) -> tuple[np.ndarray, np.ndarray]:
    """Factors (K + 3, 2) with basis (N, K + 3) @ factors = apart (N, 2), and weights (N,)."""
    count = how.knots
    cost = np.zeros((basis.shape[1],) * 2)
    bend = np.diff(np.eye(count), 2, axis=0)
    cost[:count, :count] = _BENT * bend.T @ bend + _ANY * np.eye(count)
    cost[count:, count:] = _TURNED * np.eye(3)
    weights = np.ones(len(apart))
    factors = np.zeros((basis.shape[1], 2))
    for _ in range(_TURNS):
        weighted = basis.T * (weights / len(apart))
        factors = np.linalg.solve(weighted @ basis + cost, weighted @ apart)
        rest = np.linalg.norm(apart - basis @ factors, axis=1)
        weights = 1 / (1 + (rest / (how.outlier * np.median(rest) + 1e-6)) ** 2)
    return factors, weights


def _hats(values: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(N, K): the weights of linear interpolation between `knots` (K,), constant beyond."""
    place = np.interp(values, knots, np.arange(len(knots)))
    return np.asarray(np.maximum(1 - np.abs(place[:, None] - np.arange(len(knots))), 0))


def _smooth_log(image: np.ndarray, plain: np.ndarray, deviation: float) -> np.ndarray:
    """ln of `image` (S, S, 3), averaged over plain skin alone."""
    weight = plain.astype(np.float32)[..., None]
    mean = _blurred(image * weight, deviation) / np.maximum(_blurred(weight, deviation), 1e-3)
    return np.log(np.maximum(mean, _BLACK))


def _blurred(image: np.ndarray, deviation: float) -> np.ndarray:
    return np.asarray(ndimage.gaussian_filter(image, (deviation, deviation, 0)))
