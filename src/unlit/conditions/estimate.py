"""The conditions of a photo: what its light's colour is, and where something casts a shadow."""

from __future__ import annotations

from dataclasses import replace

from ..face.conditions import Conditions
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..optimize.observation import observation
from ..perception.measures import above
from ..perception.topology import NOSE_BASE
from ..photo.photo import Photo
from ..settings.settings import Settings
from . import illuminant
from .cast_shadow import cast_shadow
from .light_color import estimated_color


def estimate_conditions(
    photo: FacePhoto, head: FittedHead, source: Photo, settings: Settings
) -> Conditions:
    """What the settings say of the light, or ask to be found; `source`: the whole photo.

    Raises SettingsError where a grey card cannot be read.
    """
    conditions = _light_color(photo, head, source, settings)
    if settings.cast_shadow.mode == "keep":
        return conditions
    seen = observation(photo, head, conditions)
    above_nose = above(photo.landmarks[:, :2], len(photo.image), NOSE_BASE)
    return replace(conditions, visibility=cast_shadow(seen, above_nose, settings))


def _light_color(
    photo: FacePhoto, head: FittedHead, source: Photo, settings: Settings
) -> Conditions:
    asked, found = settings.light_color, None
    if asked.card is not None:
        color = illuminant.of_card(source, asked.card)
    elif (stated := illuminant.stated(asked)) is not None:
        color = stated
    else:
        color, found = estimated_color(observation(photo, head, Conditions()), settings)
    face = photo.image[photo.regions.face > 0.5]
    return Conditions(illuminant.fitting(color, face), found)
