"""What is set for each region of the face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

Alpha = Annotated[float, Meta(ge=0.02, le=1)]
Level = Annotated[float, Meta(ge=0.05, le=10)]


@dataclass(frozen=True)
class RoughnessByRegion:
    """Beckmann roughness alpha (root-mean-square slope, Weyrich's m) by region.

    The values are ours: the paper follows Weyrich et al. 2006, whose face average is 0.3, without
    printing its table.

    forehead, nose, cheeks, lids, chin, upper_lip, ears, rest: of the skin there (the regions of
        head/skin_regions.py; rest is neck and scalp).
    skin: of skin on a mesh that has no such regions.
    lips, eyes, eyebrows, mouth: of what the photo shows to be that.
    """

    forehead: Alpha = 0.30
    nose: Alpha = 0.30
    cheeks: Alpha = 0.30
    lids: Alpha = 0.30
    chin: Alpha = 0.30
    upper_lip: Alpha = 0.30
    ears: Alpha = 0.30
    rest: Alpha = 0.30
    skin: Alpha = 0.30
    lips: Alpha = 0.25
    eyes: Alpha = 0.15
    eyebrows: Alpha = 0.35
    mouth: Alpha = 0.15


@dataclass(frozen=True)
class SpecularByRegion:
    """Specular albedo by region of the skin, over that of the skin as a whole.

    The stages judge gloss and its smoothness by what a map has over these.

    forehead, nose, cheeks, lids, chin, upper_lip, ears, rest: of the skin there; 1: as elsewhere.
    """

    forehead: Level = 1.0
    nose: Level = 1.0
    cheeks: Level = 1.0
    lids: Level = 1.0
    chin: Level = 1.0
    upper_lip: Level = 1.0
    ears: Level = 1.0
    rest: Level = 1.0
