"""The conditions a photo was taken under: what the user says of them, how the rest is found."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Annotated, Literal

from msgspec import Meta

from ..errors import SettingsError
from .ranges import Count, Positive, Share, Weight

AUTO = "auto"
#: Temperatures of a light that have a colour here, kelvin.
LOWEST, HIGHEST = 1700.0, 25000.0
#: Least channel of a light's colour: a photo holds nothing of a channel without light.
FAINTEST = 0.02

_NUMBER = r"(?:\d+(?:\.\d+)?|\.\d+)"
#: Three numbers of which one is larger are no linear values, but those of a colour picker.
_LINEAR = 16.0
_WAYS = "white, auto, a temperature as 2700K, the grey card's pixel X,Y, R,G,B (linear) or #rrggbb"


@dataclass(frozen=True)
class LightColorRequest:
    """What the user says of the light's colour: one of the three, or none for an estimate.

    text: as it was said. rgb: linear sRGB of something white in that light, in any unit. kelvin:
    its temperature, LOWEST to HIGHEST. card: (x, y) of a grey card, pixels of the photo. Raises
    SettingsError that lists what can be said.
    """

    text: str = field(compare=False)
    rgb: tuple[float, ...] | None = field(init=False, default=None)
    kelvin: float | None = field(init=False, default=None)
    card: tuple[float, float] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        plain = self.text.strip().lower()
        if plain == "white":
            self._know(rgb=(1.0, 1.0, 1.0))
        elif re.fullmatch(r"#[0-9a-f]{6}", plain):
            self._know(rgb=_decoded(plain))
        elif found := re.fullmatch(rf"({_NUMBER}) ?k", plain):
            self._know(kelvin=float(found[1]))
        elif plain != AUTO:
            self._know_numbers([part.strip() for part in plain.split(",")])
        if self.kelvin is not None and not LOWEST <= self.kelvin <= HIGHEST:
            raise self._wrong(f"give a temperature from {LOWEST:.0f}K to {HIGHEST:.0f}K")
        if self.rgb is not None and not (0 < max(self.rgb) < math.inf):
            raise self._wrong("give finite numbers, not all 0")
        if self.rgb is not None and min(self.rgb) < FAINTEST * max(self.rgb):
            raise self._wrong(f"every channel must be at least {FAINTEST:.0%} of the largest")

    def _know_numbers(self, numbers: list[str]) -> None:
        if len(numbers) not in (2, 3) or not all(re.fullmatch(_NUMBER, n) for n in numbers):
            raise self._wrong(f"write {_WAYS}")
        first, second, *third = map(float, numbers)
        if not third:
            self._know(card=(first, second))
            return
        rgb = (first, second, *third)
        if max(rgb) > _LINEAR:
            code = "#{:02x}{:02x}{:02x}".format(*(round(min(value, 255)) for value in rgb))
            raise self._wrong(f"three numbers are linear; for 0 to 255 of a picture write '{code}'")
        self._know(rgb=rgb)

    def _know(self, **known: object) -> None:
        vars(self).update(known)

    def _wrong(self, why: str) -> SettingsError:
        return SettingsError(f"light_color={self.text!r}: {why}", "light_color")


def _decoded(code: str) -> tuple[float, ...]:
    """Linear sRGB of #rrggbb."""
    from ..color import decode_srgb  # NumPy, for which `unlit --help` need not wait

    return tuple(decode_srgb([value / 255 for value in bytes.fromhex(code[1:])]).tolist())


@dataclass(frozen=True)
class KnownExposure:
    """What is known of the gain between albedo and light; nothing for "auto".

    text: as it was said. albedo: of a patch at (x, y), pixels of the photo, or of the whole skin,
    by Rec. 709 luminance. lux: illuminance of a surface that faces the light. Raises SettingsError
    that lists what can be said.
    """

    text: str = field(compare=False)
    albedo: float | None = field(init=False, default=None)
    at: tuple[float, float] | None = field(init=False, default=None)
    lux: float | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        plain = "".join(self.text.lower().split())
        if plain == AUTO:
            return
        known = {}
        if found := re.fullmatch(rf"({_NUMBER})lux", plain):
            known = {"lux": float(found[1])}
        elif found := re.fullmatch(rf"skin=({_NUMBER})", plain):
            known = {"albedo": float(found[1])}
        elif found := re.fullmatch(rf"({_NUMBER}),({_NUMBER})=({_NUMBER})", plain):
            known = {"albedo": float(found[3]), "at": (float(found[1]), float(found[2]))}
        vars(self).update(known)
        if not (0 < (self.lux or 0) < math.inf or 0 < (self.albedo or 0) <= 1):
            raise SettingsError(
                f"exposure={self.text!r}: write auto, skin=ALBEDO or X,Y=ALBEDO (a pixel of the "
                "photo and its albedo, above 0, at most 1), or the illuminance as 500lux",
                "exposure",
            )


@dataclass(frozen=True)
class LightColorEstimate:
    """How the light's colour is read from the gloss of the skin. Lengths: pixels of a 256 crop.

    spread: slopes are of what is left when means over this are taken away. margin: distance kept
    from what is no plain skin. blur: of image and model.
    least_shading: diffuse shading below which a pixel is left out, where full light is 1; darkest,
    brightest: linear photo values between which it is used. least_pixels: fewer tell nothing.
    blocks: a side, which are taken as independent of each other.
    systematic: error of the slopes, relative to their size, that the blocks do not show: of S, of
        the photo's tone curve.
    expected: standard deviation of lights about daylight, mired (10^6 / kelvin).
    different: lights are told from white if they differ by so many mired (30: 5,450 to 8,080 K is
        called white). told: and if white is so much less likely (difference of squared deviations).
    outlier: residuals are weighted by 1 / (1 + (r / (outlier median))^2), for freckles and hairs;
        reweighted: so often.
    """

    spread: Positive = 14.0
    margin: Annotated[int, Meta(ge=0, le=256)] = 4
    blur: Positive = 2.5
    least_shading: Share = 0.15
    darkest: Share = 0.003
    brightest: Share = 0.9
    least_pixels: Count = 500
    blocks: Annotated[int, Meta(ge=2, le=256)] = 16
    systematic: Weight = 0.05
    expected: Positive = 200.0
    different: Weight = 30.0
    told: Weight = 6.0
    outlier: Positive = 2.0
    reweighted: Annotated[int, Meta(ge=0, le=100)] = 3


CastShadowMode = Literal["auto", "keep"]


@dataclass(frozen=True)
class CastShadow:
    """What counts as a shadow of something else on the face. Lengths: pixels of a 256 crop.

    mode: auto, take it out of the photo; keep, take the photo as it is.
    dark: log ratio of photo to model below which skin is in shadow; dim: and next to such skin.
    black: added to both, linear: what a photo's black may stand for. least_seen: photo and model
        below which their ratio says nothing.
    smooth: reach of the median that the ratio is smoothed with. features: distance kept from lips,
        eyes and brows. rim: width of the face's outline.
    grown: how far beyond its core a shadow is looked for; bridged: gap between its parts that is
        closed, beside eyes and brows. soft: deviation of its edge's Gaussian;
        smoothness: of the light within it, whose finer changes are the skin's.
    sure: least weight of the mask there; where it is less there is hair, too, and it is filled in.
    least_shading: least diffuse shading that the model has there, where full light is 1.
    least, most: share of the face; more is no shadow but a wrong light. along: least share of its
        border on the face's outline. above: least share of its area above the nose's base.
    step: least change of the log ratio over its edge; what darkens more gradually is shading that
        the model has wrong. edge: width of the medians to either side between which it is taken.
    """

    mode: CastShadowMode = "auto"
    dark: Annotated[float, Meta(ge=-10, lt=0)] = -0.45
    dim: Annotated[float, Meta(ge=-10, lt=0)] = -0.2
    black: Annotated[float, Meta(gt=0, le=1)] = 0.01
    least_seen: Annotated[float, Meta(gt=0, le=1)] = 1e-3
    smooth: Annotated[int, Meta(ge=1, le=2)] = 2
    features: Annotated[int, Meta(ge=0, le=64)] = 3
    rim: Annotated[int, Meta(ge=0, le=64)] = 3
    grown: Annotated[int, Meta(ge=0, le=64)] = 4
    bridged: Annotated[int, Meta(ge=0, le=64)] = 18
    soft: Annotated[float, Meta(gt=0, le=64)] = 3.0
    smoothness: Annotated[float, Meta(gt=0, le=64)] = 3.0
    sure: Share = 0.96
    least_shading: Share = 0.15
    least: Share = 0.015
    most: Share = 0.4
    along: Share = 0.33
    above: Share = 0.5
    step: Annotated[float, Meta(ge=0, le=10)] = 0.3
    edge: Annotated[float, Meta(gt=0, le=64)] = 6.0
