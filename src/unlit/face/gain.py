"""The one gain that albedo and light share: its user may tell what the photo hardly does.

Albedo times g and light divided by g give the same picture but for what the face reflects onto
itself. The stages hold both as if the photo were exposed for a white card on the face
(`with_unit_light` in optimize/stage_run.py); inter-reflection, and the finished estimate, take
albedo times the gain that is found here: by what is known, the albedo of a patch, or of the whole
skin, or the illuminance that was measured where the face is lit best, or else a convention
(docs/method.md, 9).
"""

from __future__ import annotations

import numpy as np

from ..color import luminance
from ..errors import SettingsError
from ..settings.conditions import AUTO, KnownExposure
from .conditions import Conditions
from .photo import FacePhoto

#: The gain by convention. The photo's brightest skin is no white card: the palest returns some 0.7
#: of the light.
CONVENTION = 0.7
# Radius of a patch, as a part of the crop's width.
_PATCH = 0.01


def check_exposure(known: KnownExposure, white_luminance: float | None) -> None:
    """Raise SettingsError where lux are given and the photo tells no luminance."""
    if known.lux is not None and white_luminance is None:
        raise SettingsError(
            f"exposure={known.lux:g}lux: the photo does not tell its exposure time, f-number and "
            "ISO speed; give an albedo instead"
        )


def peak_luminance(e: np.ndarray) -> float:
    """Luminance, in the photo's linear values, of a white card where the face is lit best.

    e: (..., 3) diffuse shading in the light's colour. The 99th percentile, as in the convention.
    """
    return float(np.percentile(luminance(e), 99))


def largest_gain(albedo: np.ndarray) -> float:
    """The gain up to which albedo (N, 3) stays within 1: no skin returns more light.

    By the 99.9th percentile of its largest channel: files of 8 bits hold no more than 1 either.
    """
    return 1 / max(float(np.percentile(albedo.max(axis=1), 99.9)), 1e-6)


_NOTHING = KnownExposure(AUTO)


class AlbedoGain:
    """The gain of one photo: by what is known of it, or by convention.

    known: by the user. photo: whose skin is meant; None where nothing is known. conditions: colour
    of its light, and where a shadow is filled in. Raises SettingsError where lux are given and the
    photo tells no luminance.
    """

    def __init__(
        self,
        known: KnownExposure | None = None,
        photo: FacePhoto | None = None,
        conditions: Conditions | None = None,
    ) -> None:
        self.known = known or _NOTHING
        if photo is None or conditions is None:
            if self.known != _NOTHING:
                raise ValueError("what is known is known of a photo")
            return
        check_exposure(self.known, photo.white_luminance)
        self._photo, self._conditions = photo, conditions

    def patch(self, inside: np.ndarray) -> np.ndarray:
        """The pixels (S, S) bool whose albedo is known; `inside`: where the maps are measured.

        Raises SettingsError if there are none.
        """
        known, photo = self.known, self._photo
        if (shadow := self._conditions.shadow) is not None:
            inside = inside & (shadow.trust > 0)
        if known.at is None:
            found = inside & (photo.regions.skin > 0.5)
            if known.albedo is not None and not found.any():
                raise SettingsError("exposure: no bare skin was found; give a pixel as X,Y=ALBEDO")
            return found
        x, y = photo.crop.points(known.at)
        size = photo.crop.resolution
        ys, xs = np.mgrid[0:size, 0:size] + 0.5
        found = inside & (np.hypot(xs - x, ys - y) <= max(1.0, _PATCH * size))
        if not found.any():
            raise SettingsError(
                f"exposure: the photo's pixel {known.at[0]:g},{known.at[1]:g} is outside the photo "
                "or not on the face that is measured; choose one on bare skin"
            )
        return found

    def during_stages(self, albedo: np.ndarray, inside: np.ndarray) -> float:
        """What makes the stages' albedo (S, S, 3) the skin's, for inter-reflection.

        There the best-lit skin has E = 1 before the light's colour. inside: (S, S) bool, where
        there are maps.
        """
        if self.known == _NOTHING:
            return min(CONVENTION, largest_gain(albedo[inside]))
        full = float(luminance(self._conditions.light_color))
        gain = self._of(albedo, full, inside)
        # A measured illuminance may be wrong by any factor.
        return gain if self.known.lux is None else min(gain, largest_gain(albedo[inside]))

    def of_result(self, albedo: np.ndarray, e: np.ndarray, inside: np.ndarray) -> float:
        """The result's gain; e: (S, S, 3) its exact diffuse shading under white light."""
        if self.known == _NOTHING:
            return self.during_stages(albedo, inside)
        full = peak_luminance(e[inside] * self._conditions.light_color)
        return self._of(albedo, full, inside)

    def _of(self, albedo: np.ndarray, full: float, inside: np.ndarray) -> float:
        patch, known, unit = self.patch(inside), self.known, self._photo.white_luminance
        if known.albedo is not None:
            return known.albedo / float(luminance(albedo[patch]).mean())
        if known.lux is None or unit is None:
            raise ValueError("neither an albedo nor an illuminance in a known unit")
        return np.pi * full * unit / known.lux
