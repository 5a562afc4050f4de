"""The sun's shadow where the photo has it, and what it leaves of the light in each channel.

On both sides of a shadow's edge the albedo is the same, and the light's ratio is known from the
sun that was found. So every pixel says how far it looks lit or shaded, with the albedo's own local
level taken out; the mesh's own shadow is the prior, uncertain near its edges as the mesh is; and a
field keeps shadows in one piece whose edges are the photo's. What remains in the shade, channel by
channel, is read from both sides of the edges: sun and sky have two colours.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from ..face.conditions import Shadow
from ..optimize.observation import Observation
from ..optimize.problem import Problem
from ..scene.maps import fill
from ..settings.sun import SunShadow
from .binary_field import mean_field
from .illuminant import of_temperature
from .sun_model import huber
from .sun_search import SIZE, SunFit, Surface

#: Darker values of the photo, linear, are taken for this.
_BLACK = 0.003
#: In shade, nothing is left of what is darker; linear, 3 of 255.
_CRUSHED = 0.001
#: Encoded white is as bright as the file can be: lit, whatever it looks like.
_SATURATED = 0.97
#: Cosines to the light and to the viewer from which a pixel tells light from shade.
_FACING, _SEEN = 0.06, 0.25
#: Half of what the light is taken to subtend, radians, and the rays' bundles.
_WIDTH = 0.03
#: Pixels to both sides that an edge needs before they are compared.
_ENOUGH = 40
#: Temperature of the light in open shade, as the white balance of cameras has it, kelvin.
_SHADE = 7500
_FAINT = np.float32(1e-4)
#: What the light may be divided by, or multiplied with.
_MOST_DARK, _MOST_BRIGHT = 12.0, 1 / 0.3


def sun_shadow(
    small: Problem, surface: Surface, found: SunFit, full: Observation, settings: SunShadow
) -> Shadow:
    """The sun `found` in `small`, at most SIZE pixels a side, and its shadow in `full`."""
    view = _View(small, surface, found, settings)
    visible, remaining = view.shadow()
    return _at_full_size(view, visible, remaining, full)


class _View:
    """Images (S, S[, 3]) of what was found: light of the sun and of the rest, the photo's log."""

    def __init__(
        self, problem: Problem, surface: Surface, found: SunFit, settings: SunShadow
    ) -> None:
        seen, self.settings = problem.observation, settings
        self.found = found
        sun, rest = found.parts(surface.normal)
        self.inside = problem.inside
        self.unit = problem.camera.width / SIZE
        image = problem.image_of
        # Off the face there is light, too, whose logarithm is taken.
        self.sun, self.rest = image(sun), np.where(self.inside[..., None], image(rest), _FAINT)
        self.facing = image(np.maximum(surface.normal @ found.direction, 0))
        towards = -surface.position / np.linalg.norm(surface.position, axis=1, keepdims=True)
        viewed = image((surface.normal * towards).sum(axis=1))
        open_ = surface.open(found.direction[None], _WIDTH)[0]
        self.faced = self.inside & (self.facing > _FACING)
        self.open = np.where(self.faced, image(open_), 1)
        self.log = np.log(np.maximum(seen.image, _BLACK))
        self.grey = self.log.mean(axis=2)
        self.features = seen.regions[..., 1:].sum(axis=2)
        self.plain = (seen.regions[..., 0] > 0.7) & self.inside & (self.features < 0.15)
        self.plain &= viewed > _SEEN
        self.saturated = seen.image.max(axis=2) > _SATURATED

    def blur(self, values: np.ndarray, deviation: float) -> np.ndarray:
        """Gaussian over (S, S) or (S, S, 3)."""
        reach = deviation * self.unit
        return np.asarray(ndimage.gaussian_filter(values, (reach, reach, 0)[: values.ndim]))

    def light(self, visible: np.ndarray | float, remaining: np.ndarray) -> np.ndarray:
        """Log light (S, S, 3) at a visibility (S, S) of the sun."""
        share = np.asarray(visible, np.float32)[..., None]
        return np.log(share * self.sun + self.rest * remaining)

    def white(self, remaining: np.ndarray) -> np.ndarray:
        """(3,) what something white would look like in the photo, in any unit.

        Two things are known, neither well: the camera's balance makes the light as a whole white,
        a quarter of the sun (all directions) and the rest; and open shade is of some 7,500 K.
        The geometric mean of both.
        """
        rest = self.found.level * remaining
        whole = self.found.color / 4 + rest
        return np.sqrt(whole * rest / of_temperature(_SHADE))

    def shadow(self) -> tuple[np.ndarray, np.ndarray]:
        """Visibility (S, S), and factors (3,) on the rest of the light."""
        how, remaining = self.settings, np.ones(3, np.float32)
        prior = np.clip(self.blur(self.open, how.own_blur), how.own_least, 1 - how.own_least)
        prior = how.own_weight * np.log(prior / (1 - prior)) * self.faced
        level, visible = np.zeros_like(self.grey), np.ones_like(self.grey)
        for turn in range(how.rounds):
            if turn:
                level = self._level(visible, remaining)
            evidence = self._evidence(level, remaining) + prior
            field = (how.contrast, how.agreement, how.sweeps)
            visible = mean_field(evidence, self.grey, self.faced, *field)
            visible = self._with_features(np.where(self.faced, visible, 1))
            remaining = remaining * self._across_edges(visible, remaining)
        return visible, remaining

    def _level(self, visible: np.ndarray, remaining: np.ndarray) -> np.ndarray:
        """Local mean of the log albedo, from skin that is surely lit or shaded."""
        rest = self.grey - self.light(visible, remaining).mean(axis=2)
        sure = self.plain & (np.abs(2 * visible - 1) > 0.6)
        weight = sure / (1 + (rest / 0.4) ** 2)
        reach = self.settings.level
        return self.blur(weight * rest, reach) / (self.blur(weight, reach) + 0.08)

    def _evidence(self, level: np.ndarray, remaining: np.ndarray) -> np.ndarray:
        """Log odds of being lit that every pixel has alone."""
        how = self.settings
        lit, shaded = (self.light(v, remaining).mean(axis=2) for v in (1.0, 0.0))
        costs = [np.minimum(huber((self.grey - x - level) / how.error), 8) for x in (lit, shaded)]
        told = np.clip((lit - shaded) / how.told, 0, 1) * np.where(self.plain, 1, how.feature)
        evidence = np.clip(costs[1] - costs[0], -how.surest, how.surest) * told
        return np.where(self.saturated, 3, evidence) * self.faced

    def _with_features(self, visible: np.ndarray) -> np.ndarray:
        """Brows, eyes and lips as the plain skin around them; the mesh's shadow where none is."""
        plain = (self.plain & self.faced).astype(np.float32)
        near, wide = (self.blur(plain, f * self.settings.fill) for f in (1, 3))
        inside = self.blur(visible * plain, self.settings.fill) / np.maximum(near, 1e-4)
        around = self.blur(visible * plain, 3 * self.settings.fill) / np.maximum(wide, 1e-4)
        filled = np.where(near > 0.02, inside, np.where(wide > 0.005, around, self.open))
        return np.where(self.plain | ~self.faced, visible, filled)

    def _across_edges(self, visible: np.ndarray, remaining: np.ndarray) -> np.ndarray:
        """Factors (3,) on what is left in the shade, so that albedo is the same on both sides."""
        how = self.settings
        steep = ndimage.gaussian_gradient_magnitude(visible * self.faced + ~self.faced, self.unit)
        known = ~_grown(~self.faced, how.edge * self.unit)
        edge = known & (steep > 0.08 / self.unit)
        beside = _grown(edge, how.beside * self.unit) & ~_grown(edge, how.edge * self.unit)
        beside &= known & self.plain
        lit, shaded = beside & (visible > 0.9), beside & (visible < 0.1)
        if min(lit.sum(), shaded.sum()) < _ENOUGH:
            return np.ones(3, np.float32)
        weight = lit.astype(np.float32)
        near = self.blur(weight, how.side)
        albedo = self.log - self.light(1.0, remaining)
        albedo = self.blur(albedo * weight[..., None], how.side) / np.maximum(near, 1e-4)[..., None]
        step = (self.log - self.light(0.0, remaining) - albedo)[shaded & (near > 0.02)]
        if len(step) < _ENOUGH:
            return np.ones(3, np.float32)
        return np.exp(0.8 * np.clip(np.median(step, axis=0), -1, 1)).astype(np.float32)


def _at_full_size(
    view: _View, visible: np.ndarray, remaining: np.ndarray, full: Observation
) -> Shadow:
    """Along the edges the visibility is what the photo says with the albedo of both sides."""
    size = len(full.image)

    def grown(image: np.ndarray) -> np.ndarray:
        if len(image) == size:
            return image
        return cv2.resize(fill(image, view.inside), (size, size), interpolation=cv2.INTER_LINEAR)

    unit = size / SIZE
    inside = cv2.resize(view.inside.astype(np.float32), (size, size)) > 0.5
    sun, rest, facing = grown(view.sun), grown(view.rest * remaining), grown(view.facing)
    visible = np.clip(grown(visible.astype(np.float32)), 0, 1)
    features = full.regions[..., 1:].sum(axis=2)

    def mean(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
        reach: Any = 4 * unit
        return np.asarray(ndimage.gaussian_filter(values * weight[..., None], (reach, reach, 0)))

    steep = ndimage.gaussian_gradient_magnitude(np.where(inside, visible, 1), unit)
    band = _grown(steep > 0.05 / unit, 3 * unit) & inside & (facing > 0.1) & (features < 0.3)
    albedo = np.log(np.maximum(full.image, _BLACK)) - np.log(visible[..., None] * sun + rest)
    sure = (inside & ~band & (features < 0.3)).astype(np.float32)
    near = np.asarray(ndimage.gaussian_filter(sure, 4 * unit))[..., None]
    around = np.exp(mean(albedo, sure) / np.maximum(near, 1e-4))
    told = ((full.image / around).mean(axis=2) - rest.mean(axis=2)) / np.maximum(
        sun.mean(axis=2), 1e-4
    )
    told = np.asarray(ndimage.gaussian_filter(np.clip(told, 0, 1), 0.6))
    visible = np.where(band & (near[..., 0] > 0.02), told, visible).astype(np.float32)
    reference = view.white(remaining)
    whole = ((sun + rest) / reference).mean(axis=2, keepdims=True)
    left = (visible[..., None] * sun + rest) / reference / np.maximum(whole, 1e-6)
    left = np.where(inside[..., None], np.clip(left, 1 / _MOST_DARK, _MOST_BRIGHT), 1)
    # Deep shade is noise, and along the edges either side may be meant.
    trust = np.sqrt(np.clip(left.min(axis=2), 0.1, 1)) * (1 - 2 * visible * (1 - visible))
    trust = trust * ((left.min(axis=2) > 0.5) | (full.image.max(axis=2) > _CRUSHED))
    made = (visible, left, trust, view.found.direction)
    return Shadow(*(np.asarray(x, np.float32) for x in made))


def _grown(mask: np.ndarray, reach: float) -> np.ndarray:
    """`mask` and what is within `reach` pixels of it."""
    if not mask.any():
        return mask
    return np.asarray(ndimage.distance_transform_edt(~mask)) <= max(round(reach), 1)
