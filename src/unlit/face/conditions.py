"""What belongs to the moment of the photo besides the light's directions: its colour, its sun."""

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
class Sun:
    """One small light that shares the face with an even one of another colour, and its shadow.

    direction: (3,) float32, unit, world frame, towards it. visibility: (S, S) float32 in [0, 1],
    the share of it that the photo has. remaining: (S, S, 3) float32 > 0, what the photo's light is
    of what it would be without the shadow and of one colour; 1 off the face.
    """

    direction: np.ndarray
    visibility: np.ndarray
    remaining: np.ndarray

    __repr__ = short_repr

    def trust(self) -> np.ndarray:
        """(S, S) in [0, 1]: how far the photo counts: less in deep shade, and along its edges."""
        dark = np.sqrt(np.clip(self.remaining.min(axis=2), 0.1, 1))
        return dark * (1 - 2 * self.visibility * (1 - self.visibility))


@dataclass(frozen=True)
class Conditions:
    """light_color: (3,) float32 linear sRGB, > 0. light_estimate: None where it was not estimated.

    visibility: (S, S) float32 in [0, 1], 0 where something else than the head casts a shadow on
    it, and nothing is measured; None without such a shadow. sun: None where none was found.
    """

    light_color: np.ndarray = field(default_factory=WHITE.copy)
    light_estimate: LightEstimate | None = None
    visibility: np.ndarray | None = None
    sun: Sun | None = None

    __repr__ = short_repr

    def balanced(self, image: np.ndarray) -> np.ndarray:
        """`image` (S, S, 3), linear sRGB, as it would be under white light, the sun unblocked."""
        if self.sun is not None:
            image = image / self.sun.remaining
        return image if is_white(self.light_color) else image / self.light_color
