"""The level of gloss that plain skin has, and the most that a photo leaves room for.

Gloss has the light's colour, the body of the skin has less of its weakest channel: in a dim photo,
or under a warm light that is taken for white, gloss of a clean surface would be all there is in
that channel, and the albedo there 0 (docs/method.md, 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..settings.settings import Settings

mi = mitsuba()

_LEAST = 1e-6


@dataclass(frozen=True)
class GlossLevel:
    """Specular albedo: nominal, what its cost pulls to; most, its upper bound."""

    nominal: float
    most: float

    @staticmethod
    def of(settings: Settings, s: Any = None, weakest: Any = None) -> GlossLevel:
        """Where gloss is at most `settings.gloss_share` of the weakest channel of half the pixels.

        s: specular shading, mi.Float or mi.Color3f, and weakest: mi.Float, the least of the photo's
        three channels there, linear; without them the settings' own levels.
        """
        most = settings.max_specular
        if s is not None:
            share = weakest.numpy() / np.maximum(dr.mean(dr.detach(mi.Color3f(s))).numpy(), _LEAST)
            most = min(most, max(settings.gloss_share * float(np.median(share)), _LEAST))
        return GlossLevel(min(settings.nominal_specular, most), most)

    @cached_property
    def log(self) -> tuple[Any, Any]:
        """Both as ln, mi.Float; opaque, or every photo would have its own compiled kernels."""
        return dr.opaque(mi.Float, np.log(self.nominal)), dr.opaque(mi.Float, np.log(self.most))
