"""What counts as a sun, and how its shadow is told from the skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from .ranges import Count, Positive, Share, Weight

SunMode = Literal["auto", "always", "never"]


@dataclass(frozen=True)
class SunSearch:
    """How one small light is found, and its shadow. Lengths: pixels of a 256 crop.

    mode: auto, where the photo has evidence of it; always, whatever the evidence; never.

    samples: pixels of plain skin that it is looked for in; neighbours: of them over which costs
        are averaged. darkest, brightest: linear values between which a pixel is used.
    directions: over the whole sphere, of which those are searched that can light a face.
    error: of the log brightness, deviation up to which costs are squares. own_shadow: cost of a
        pixel that is not as the mesh's own shadow has it.
    outlier: highest cost of a pixel where models are compared. evidence: how much lower the mean
        cost has to be with a sun than with any even light. sky: what it counts besides that the
        rest of the light is bluer than the sun as only a sky is.
    stronger, bluer: the ranges that sun and sky have: E by the sun where it is faced over that by
        the rest, and blue over red in the rest over that in the sun.
    """

    mode: SunMode = "auto"
    samples: Annotated[int, Meta(ge=100, le=100_000)] = 2500
    neighbours: Count = 24
    darkest: Share = 0.004
    brightest: Share = 0.95
    directions: Annotated[int, Meta(ge=16, le=10_000)] = 160
    error: Positive = 0.18
    own_shadow: Weight = 0.7
    outlier: Positive = 1.2
    evidence: Annotated[float, Meta(ge=-10, le=10)] = 0.055
    sky: Weight = 0.15
    stronger: tuple[Positive, Positive] = (3.0, 14.0)
    bluer: tuple[Positive, Positive] = (1.4, 7.0)


@dataclass(frozen=True)
class SunShadow:
    """How the sun's shadow is told at every pixel. Lengths: pixels of a 256 crop.

    error: as of the search, but within one face's local level of albedo; level: its deviation.
        surest: most that one pixel says for or against shade. feature: how much less lips, eyes and
        brows say, which are dark themselves.
    told: difference of the log brightness of light and shade from which a pixel tells them apart
        fully.
    own_blur: deviation of the mesh's own shadow, for the error of the mesh; own_weight: what it
        counts; own_least: least and, from 1, highest share that it is taken to be sure of.
    contrast: change of the log brightness across which neighbours need not agree; agreement: what
        it costs if they do not.
    fill: deviation with which plain skin decides for features.
    edge: width of an edge. beside: how far from it its sides are compared; side: averaged over.
    rounds: of labels and of what is left in the shade; sweeps: of the field in each.
    """

    error: Positive = 0.22
    level: Positive = 12.0
    surest: Positive = 5.0
    feature: Share = 0.12
    told: Positive = 0.4
    own_blur: Positive = 2.5
    own_weight: Weight = 0.5
    own_least: Annotated[float, Meta(gt=0, lt=0.5)] = 0.1
    contrast: Positive = 0.12
    agreement: Weight = 1.0
    fill: Positive = 2.0
    edge: Positive = 2.0
    beside: Positive = 9.0
    side: Positive = 6.0
    rounds: Count = 4
    sweeps: Count = 60
