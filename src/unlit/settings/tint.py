"""How the colour that changes over a face is told from the skin's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from .ranges import Count, Positive, Share

TintMode = Literal["auto", "never"]


@dataclass(frozen=True)
class TintSearch:
    """What the two halves of a face say of the light's colour. Lengths: pixels of a 256 crop.

    mode: auto, where the halves differ; never.

    least: difference of the halves' colour, root mean square of ln R/G and ln B/G, that is taken
        for the skin's own and the method's error: heads photographed by a plain camera have .14 at
        most.
    symmetric: share that is taken out of what is the same on both halves, where pigment can be,
        too.
    pairs: fewer tell nothing. apart: distance from the mirror image, cm, up to which a point is
        taken for it; beside: from the middle of the face, cm, from which halves are compared.
    knots: of the curve over the log brightness. outlier: residuals are weighted by
        1 / (1 + (r / (outlier median))^2), for moles and make-up.
    glossy: share of gloss in the brightness from which a pixel is left out.
    blur: deviation over which colours are compared; wide: of what brows, eyes and lips get from
        around.
    """

    mode: TintMode = "auto"
    least: Positive = 0.15
    symmetric: Share = 0.5
    pairs: Count = 1500
    apart: Positive = 0.35
    beside: Positive = 0.4
    knots: Annotated[int, Meta(ge=3, le=64)] = 7
    outlier: Positive = 2.0
    glossy: Share = 0.35
    blur: Positive = 1.5
    wide: Positive = 8.0
