"""What belongs to the moment of the photo besides the light's directions: colour and shadow."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..color import WHITE, is_white
from ..scene.short_repr import short_repr


@dataclass(frozen=True)
class LightEstimate:
    """What an estimate of the light's colour says of itself.

    used: whether it was taken. kelvin: the likeliest temperature; low, high: one deviation about
    it, kelvin too; excess: squared deviations by which white is less likely. None where nothing was
    found.
    """

    used: bool
    kelvin: float | None = None
    low: float | None = None
    high: float | None = None
    excess: float | None = None


@dataclass(frozen=True)
class Shadow:
    """A shadow on the face that the head alone does not cast, or not there.

    visibility: (S, S) float32 in [0, 1], 0 in the shadow. remaining: (S, S, 3) float32 > 0, what
    the photo's light is of what it would be without the shadow and of one colour; 1 off the face.
    trust: (S, S) float32 in [0, 1], how far what that makes of the photo counts: 0 where it is
    filled in. sun: (3,) float32, unit, world frame, towards the light that is shaded, if found.
    """

    visibility: np.ndarray
    remaining: np.ndarray
    trust: np.ndarray
    sun: np.ndarray | None = None

    __repr__ = short_repr


@dataclass(frozen=True)
class Conditions:
    """light_color: (3,) float32 linear sRGB, > 0, what white in full light has in the photo: below
    1 where the photo is dim. light_estimate: None where the colour was not estimated. shadow: None
    where none was found. tint: (S, S, 3) float32 > 0, what the photo is of what light of
    one colour would make it (conditions/tint.py); None where it is even.
    """

    light_color: np.ndarray = field(default_factory=WHITE.copy)
    light_estimate: LightEstimate | None = None
    shadow: Shadow | None = None
    tint: np.ndarray | None = None

    __repr__ = short_repr

    def balanced(self, image: np.ndarray) -> np.ndarray:
        """`image` (S, S, 3), linear sRGB, as it would be under white light without the shadow."""
        remaining = self.remaining()
        if remaining is not None:
            image = image / remaining
        return image if is_white(self.light_color) else image / self.light_color

    def remaining(self) -> np.ndarray | None:
        """(S, S, 3) float32 > 0, what shadow and tint leave of white light; None: all."""
        if self.shadow is None:
            return self.tint
        return self.shadow.remaining if self.tint is None else self.shadow.remaining * self.tint
