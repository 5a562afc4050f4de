"""The gain that albedo and light share: its user may tell what the photo hardly does.

Albedo times g and light divided by g give the same picture but for what the face reflects onto
itself. The stages hold both as if the photo were exposed for a white card on the face
(`optimize.stages.exposed`); inter-reflection, and the finished estimate, take albedo times the gain
that is found here: by what is known, the albedo of a patch, or of the whole skin, or the
illuminance that was measured where the face is lit best, or else a convention (docs/method.md, 9).
"""

from __future__ import annotations

import numpy as np

from ..color import luminance
from ..errors import SettingsError
from ..photo.crop import Crop
from ..settings.conditions import KnownExposure

#: The gain by convention. The photo's brightest skin is no white card: the palest returns some 0.7
#: of the light.
CONVENTION = 0.7
# Radius of a patch, as a part of the crop's width.
_PATCH = 0.01


def patch(known: KnownExposure, crop: Crop, inside: np.ndarray, skin: np.ndarray) -> np.ndarray:
    """The pixels (S, S) bool whose albedo is known. Raises SettingsError if none is measured.

    inside: (S, S) bool, where the maps are measured; skin: (S, S) the soft mask.
    """
    if known.at is None:
        found = inside & (skin > 0.5)
        if known.albedo is not None and not found.any():
            raise SettingsError("exposure: no bare skin was found; give a pixel as X,Y=ALBEDO")
        return found
    x, y = crop.points(known.at)
    size = crop.resolution
    ys, xs = np.mgrid[0:size, 0:size] + 0.5
    found = inside & (np.hypot(xs - x, ys - y) <= max(1.0, _PATCH * size))
    if not found.any():
        raise SettingsError(
            f"exposure: the photo's pixel {known.at[0]:g},{known.at[1]:g} is outside the photo or "
            "not on the face that is measured; choose one on bare skin"
        )
    return found


def check_unit(known: KnownExposure, unit: float | None) -> None:
    """Raise SettingsError where lux are given and the photo has no unit (`Photo.unit`)."""
    if known.lux is not None and unit is None:
        raise SettingsError(
            f"exposure={known.lux:g}lux: the photo does not tell its exposure time, f-number and "
            "ISO speed; give an albedo instead"
        )


def full_light(e: np.ndarray) -> float:
    """Luminance, in the photo's linear values, of a white card where the face is lit best.

    e: (..., 3) diffuse shading in the light's colour. The 99th percentile, as in the convention.
    """
    return float(np.percentile(luminance(e), 99))


def within_one(albedo: np.ndarray) -> float:
    """The gain up to which albedo (N, 3) stays within 1: no skin returns more light.

    By the 99.9th percentile of its largest channel: files of 8 bits hold no more than 1 either.
    """
    return 1 / max(float(np.percentile(albedo.max(axis=1), 99.9)), 1e-6)


def conventional_gain(albedo: np.ndarray) -> float:
    """The gain of albedo (N, 3) of which nothing is known."""
    return min(CONVENTION, within_one(albedo))


def gain(
    known: KnownExposure, albedo: np.ndarray, full: float = 1.0, unit: float | None = None
) -> float:
    """What albedo is to be multiplied with, and light divided by.

    albedo: (N, 3) diffuse, of the patch. full: `full_light` of the face, and unit: `Photo.unit`,
    both for lux alone. Raises ValueError if nothing is known.
    """
    if known.albedo is not None:
        return known.albedo / float(luminance(albedo).mean())
    if known.lux is None or unit is None:
        raise ValueError("neither an albedo nor an illuminance in a known unit")
    return np.pi * full * unit / known.lux
