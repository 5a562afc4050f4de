"""The conditions of a photo: its sun, its light's colour, shadows of something else, its tint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..face.conditions import Conditions, Shadow
from ..face.gain import AlbedoGain
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..optimize.observation import observation
from ..optimize.problem import Problem
from ..perception.measures import above
from ..perception.topology import NOSE_BASE
from ..photo.photo import Photo
from ..progress.callbacks import silent
from ..settings.settings import Settings
from . import illuminant
from .cast_shadow import cast_shadow
from .halves import across
from .light_color import estimated_color
from .sun_search import SIZE, Surface, find_sun
from .sun_shadow import sun_shadow
from .tint import tint


def estimate_conditions(
    photo: FacePhoto, head: FittedHead, source: Photo, settings: Settings
) -> Conditions:
    """What the settings say of the light, or ask to be found; `source`: the whole photo.

    Raises SettingsError where a grey card cannot be read.
    """
    white = np.full(3, illuminant.white_level(source), np.float32)
    sun = _sun(photo, head, settings)
    conditions = _light_color(photo, head, source, settings, Conditions(white, shadow=sun))
    if sun is None and settings.cast_shadow.mode != "keep":
        seen = observation(photo, head, conditions)
        above_nose = above(photo.landmarks[:, :2], len(photo.image), NOSE_BASE)
        conditions = replace(conditions, shadow=cast_shadow(seen, above_nose, settings))
    if settings.tint.mode == "never":
        return conditions
    seen = observation(photo, head, conditions)
    return replace(conditions, tint=tint(seen, across(photo.landmarks), settings))


def _sun(photo: FacePhoto, head: FittedHead, settings: Settings) -> Shadow | None:
    mode = settings.sun.mode
    if mode == "never":
        return None
    seen = observation(photo, head, Conditions())
    try:
        problem = Problem(seen.reduced(SIZE), settings, AlbedoGain(), silent)
    except ValueError:  # the head and the mask do not overlap: `solve` says so
        return None
    surface = Surface(problem)
    found = find_sun(problem, surface, settings.sun)
    if found is None or (mode == "auto" and found.evidence < settings.sun.evidence):
        return None
    return sun_shadow(problem, surface, found, seen, settings.sun_shadow)


def _light_color(
    photo: FacePhoto, head: FittedHead, source: Photo, settings: Settings, known: Conditions
) -> Conditions:
    asked, found = settings.light_color, None
    if asked.card is not None:
        color = illuminant.of_card(source, asked.card)
    elif (stated := illuminant.stated(asked)) is not None:
        color = stated
    else:
        seen = observation(photo, head, Conditions(known.light_color))
        color, found = estimated_color(seen, settings)
    face = photo.image[photo.regions.face > 0.5]
    color = illuminant.fitting(color * known.light_color, face)
    return replace(known, light_color=color, light_estimate=found)
