"""What stage 5 leaves of the photo's finest detail, and where it goes."""

from __future__ import annotations

from dataclasses import dataclass

from .ranges import Positive, Share, Weight


@dataclass(frozen=True)
class FineDetail:
    """Lengths: pixels of a crop of 512.

    relief: what the fine part of the normal perturbation is multiplied with, 1 leaves it as stages
        4 and 5 have it. relief_length: what is finer is fine. darkest: E below which nothing is
        told of normals, where full light is 1. pigment: how many times the usual contrast of
        colour marks a pigment, whose edges are no relief.
    albedo_length: what is finer than this goes from the photo into the diffuse albedo. most: of it,
        the largest difference of ln albedo.
    shade: E below which all detail that is fine enough goes there, and from which none does.
        shade_length: what is finer than this is. shade_error: differences of ln albedo on skin that
        shading may have made; shade_range: what is left of them at most, darker and brighter.
    highlight_length: how far around a pixel the colour of the skin's body is looked for.
        highlight_margin: how much brighter and whiter than that, over its level, no highlight is.
        highlight_most: soft bound of the specular albedo that a highlight adds; 0 adds none.
    """

    relief: Weight = 3.0
    relief_length: Positive = 8.0
    darkest: Share = 0.15
    pigment: Positive = 3.0
    albedo_length: Positive = 2.0
    most: Weight = 0.2
    shade: tuple[Positive, Positive] = (0.15, 0.45)
    shade_length: Positive = 32.0
    shade_error: Weight = 0.12
    shade_range: tuple[float, float] = (-1.2, 0.4)
    highlight_length: Positive = 32.0
    highlight_margin: Share = 0.03
    highlight_most: Weight = 4.0
