"""Shadows that something else casts on the face: a hat's brim, hair, a hand held up.

In the stages nothing but the head itself blocks the light, so such a shadow would be painted into
the albedo, and bend the light on the way. A short stage 1, in which all skin has one colour, cannot
explain it. What is left over is a large part of the skin, much darker than the model, that begins
at the face's outline, beyond which the thing is that casts it. There the photo is divided by what
the shadow leaves of the light, and counts less; roots of hair have no weight and are filled in.
What is dark otherwise stays skin: moles, birthmarks and folds do not reach the outline, beards lie
below the nose, freckles are small.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from ..color import UNCLIPPED, decode_srgb
from ..face.conditions import Shadow
from ..optimize.observation import Observation
from ..settings.conditions import CastShadow
from ..settings.settings import Settings
from .first_stage import ShortStage1, short_stage1

#: Side at which shadows are looked for; the settings' lengths are pixels of it.
_SIZE = 256
#: What a photo's white may stand for.
_WHITE = float(decode_srgb(np.float32(UNCLIPPED[1])))


def cast_shadow(observation: Observation, above: np.ndarray, settings: Settings) -> Shadow | None:
    """The shadow of something else on the observation's S x S pixels.

    above: (S, S) bool, what lies above the base of the nose. None where there is no shadow, or the
    head and the mask do not overlap.
    """
    size = len(above)
    small = observation.reduced(_SIZE)
    above = cv2.resize(above.astype(np.uint8), small.mask.shape[::-1]) > 0
    dark = np.zeros(small.mask.shape, dtype=bool)
    for _ in range(2):  # again with a light that the shadow has not bent
        weight = np.where(dark, 0, small.weight).astype(np.float32)
        try:
            stage1 = short_stage1(replace(small, weight=weight), replace(settings, bounces=0))
        except ValueError:
            return None
        dark = shadowed(small, stage1, above, settings.cast_shadow)
        if not dark.any():
            return None
    left = remaining(small, stage1, dark, settings.cast_shadow)
    around = _grown(dark, 1)
    # Where the mask is not sure, it is roots of hair that are dark.
    sure = small.weight >= settings.cast_shadow.sure
    known = np.where(around, sure * np.sqrt(left.min(axis=2)), 1)
    made = (~around, left, known)
    return Shadow(*(cv2.resize(x.astype(np.float32), (size, size)) for x in made))


def remaining(
    observation: Observation, stage1: ShortStage1, dark: np.ndarray, settings: CastShadow
) -> np.ndarray:
    """What the shadow `dark` (H, W) leaves of the light: (H, W, 3) float32, above 0, 1 without it.

    The photo over stage 1's render, smooth: shading is, details are the skin's, and of brows, eyes
    and lips nothing is known.
    """
    least = settings.least_seen
    ratio = np.log(np.maximum(observation.image, least) / np.maximum(stage1.render, least))
    plain = dark & (observation.regions[..., 1:].sum(axis=2) < 0.1)
    weight = (plain if plain.any() else dark).astype(np.float64)

    def spread(values: np.ndarray, reach: float) -> np.ndarray:
        return np.asarray(ndimage.gaussian_filter(values, (reach, reach, 0)[: values.ndim]))

    near = spread(weight, settings.smoothness)[..., None]
    mean = spread(ratio * weight[..., None], settings.smoothness) / np.maximum(near, 1e-6)
    mean = np.where(near > 1e-3, mean, np.average(ratio[weight > 0], axis=0))
    edge = spread(_grown(dark, 1).astype(np.float64), settings.soft)[..., None]
    return np.exp(np.minimum(mean, 0) * edge).astype(np.float32)


def shadowed(
    observation: Observation, stage1: ShortStage1, above: np.ndarray, settings: CastShadow
) -> np.ndarray:
    """(H, W) bool: the skin in the shadow of something else, given what stage 1 makes of it."""
    # A photo is no brighter than white, whatever the model would have.
    photo, model = (
        np.clip(x, 0, _WHITE) + settings.black for x in (observation.image, stage1.render)
    )
    ratio = np.log(photo / model).mean(axis=2)
    # Ears and neck are darker and lighter than the model by its own errors.
    covered = stage1.covered & observation.fitted
    ratio = np.where(covered, ratio, 0).astype(np.float32)
    ratio = cv2.medianBlur(ratio, 2 * settings.smooth + 1)
    features = observation.regions[..., 1:].sum(axis=2)  # all but skin
    skin = covered & (features < 0.5) & (stage1.diffuse_shading > settings.least_shading)
    plain = skin & ~_grown(features > 0.1, settings.features)
    # At a bald head's outline the model has no light to compare.
    lit = covered & (stage1.diffuse_shading > settings.least_shading)
    whole: Any = ndimage.binary_fill_holes(lit)
    rim = _grown(~whole, settings.rim + 1)
    dark = (plain & (ratio < settings.dark)).astype(np.uint8)
    core = cv2.morphologyEx(dark, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(core, connectivity=4)
    found = np.zeros_like(skin)
    for label in range(1, count):
        part = labels == label
        border = _grown(part, 1) & ~part
        large = part.sum() > settings.least * covered.sum()
        if large and rim[border].mean() > settings.along and above[part].mean() > settings.above:
            found |= part
    # Between its parts it lies beside eyes and brows, too.
    near = cv2.erode(
        _grown(found, settings.grown + settings.bridged).astype(np.uint8),
        np.ones((2 * settings.bridged + 1,) * 2, np.uint8),
    )
    found |= skin & (ratio < settings.dim) & (near > 0)
    found &= ~_without_edge(found, ratio, plain, settings)
    return found if found.sum() <= settings.most * covered.sum() else np.zeros_like(found)


def _without_edge(
    found: np.ndarray, ratio: np.ndarray, plain: np.ndarray, settings: CastShadow
) -> np.ndarray:
    """(H, W) bool: the parts that darken gradually, as shading does that the model has wrong."""
    count, labels = cv2.connectedComponents(found.astype(np.uint8), connectivity=4)
    result = np.zeros_like(found)
    for label in range(1, count):
        part = labels == label
        beside = plain & ~found & (_distance_to(part) <= settings.edge)
        within = plain & part & (_distance_to(beside) <= settings.edge)
        if within.any() and np.median(ratio[beside]) - np.median(ratio[within]) < settings.step:
            result |= part
    return result


def _distance_to(mask: np.ndarray) -> np.ndarray:
    return np.asarray(ndimage.distance_transform_edt(~mask))


def _grown(mask: np.ndarray, reach: int) -> np.ndarray:
    side = 2 * reach + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
