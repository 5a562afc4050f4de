"""The albedo maps by a primal-dual method, which suits absolute values.

The image loss and the total variation are sums of absolute values, whose slopes are +1 or -1
however close to the kink. Each |r| is the most that u r reaches for -1 <= u <= 1: here u climbs
with r while the maps descend the sum (Chambolle & Pock 2011, steps by element after Pock &
Chambolle 2011, residuals that are not linear after Valkonen 2014). At the solution u says how hard
a pixel pulls; nothing jitters and no rate has to decay. Mesh and normals take their gradients from
the same u.
"""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr

from ..color import UNCLIPPED
from ..machine.runtime import mitsuba
from ..scene.arrays import at_least, at_most
from ..settings.settings import Settings
from .gloss_level import GlossLevel
from .losses import Neighbours, encode

mi = mitsuba()

#: How far one step may take encoded diffuse albedo, log specular albedo, the level of the latter
#: as a whole, a normal.
_DIFFUSE, _SPECULAR, _LEVEL, _NORMAL = 0.03, 0.01, 0.02, 0.03
_DARKEST = 1e-5


def decode(encoded: Any) -> Any:
    """Linear values from sRGB-encoded ones; the power continues above 1."""
    power: Any = dr.power(dr.fmax((encoded + 0.055) / 1.055, _DARKEST), 2.4)
    return dr.select(encoded <= 0.04045, encoded / 12.92, power)


def encoding_slope(linear: Any) -> Any:
    """Derivative of `encode`."""
    power: Any = dr.power(dr.fmax(linear, _DARKEST), 1 / 2.4 - 1)
    return dr.select(linear <= 0.0031308, 12.92, (1.055 / 2.4) * power)


def _towards(value: Any, kink: Any, pace: Any) -> Any:
    """`value` nearer to `kink` by `pace`, or just there: the exact step of |value - kink|."""
    away = value - kink
    return kink + dr.sign(away) * dr.fmax(dr.abs(away) - pace, 0)


class PrimalDual:
    """The maps of P pixels and what pulls at them.

    target: mi.Color3f, encoded and censored. state: of the estimate, by the names in STATE.
    log_level: mi.Float, ln of the specular albedo that is given; what the map has over it is
    smooth, and near its nominal level.

    As attributes: diffuse: mi.Color3f, encoded. relative: mi.Float, ln specular albedo over its
    level. pull: mi.Color3f, how hard each pixel and channel of the photo pulls, -1 to 1. right,
    below: mi.Vector4f, the same of the differences to the right and below, of the three encoded
    diffuse channels and of `relative`, up to the weight of the smoothness.
    """

    STATE: ClassVar = ("log_diffuse", "log_specular", "pull", "right", "below")

    def __init__(
        self,
        neighbours: Neighbours,
        target: Any,
        settings: Settings,
        state: dict[str, Any],
        log_level: Any = 0.0,
    ) -> None:
        self.neighbours, self.target, self.settings = neighbours, target, settings
        bounds = encode(mi.Float(_DARKEST, settings.max_diffuse)).numpy()
        self.bounds = tuple(float(bound) for bound in bounds)
        self.diffuse = encode(dr.exp(state["log_diffuse"]))
        self.log_level = mi.Float(log_level)
        self.relative = mi.Float(state["log_specular"]) - self.log_level
        self.begin = mi.Color3f(self.diffuse)
        self.ahead = (self.diffuse, self.relative)
        self.pull, self.right, self.below = state["pull"], state["right"], state["below"]
        own = dr.arange(mi.UInt32, dr.width(self.relative))
        self.inner = (neighbours.left != own, neighbours.above != own)
        self.perturbation: Any = None
        dr.eval(self.diffuse, self.relative, self.inner)

    @property
    def log_diffuse(self) -> Any:
        """mi.Color3f, ln of linear albedo, as the estimate has it."""
        return dr.log(decode(self.diffuse))

    @property
    def log_specular(self) -> Any:
        """mi.Float, ln of specular albedo, as the estimate has it."""
        return self.relative + self.log_level

    def brighten(self, shift: float) -> None:
        """Albedo times exp(shift)."""
        self.diffuse = encode(decode(self.diffuse) * dr.exp(dr.opaque(mi.Float, shift)))
        self.begin = encode(decode(self.begin) * dr.exp(dr.opaque(mi.Float, shift)))
        self.relative = self.relative + dr.opaque(mi.Float, shift)
        self.ahead = (self.diffuse, self.relative)
        dr.eval(self.ahead, self.begin)

    def step(
        self,
        e: Any,
        s: Any,
        weight: Any,
        unseen: Any,
        gloss: GlossLevel,
        image: float,
        smooth_diffuse: float,
        smooth_specular: float,
    ) -> None:
        """One step up of what pulls, one step down of the maps, under the shading E, S.

        weight: of the pixels, mean 1. unseen: how little they say, 0 to 1. gloss: its levels.
        image, smooth_diffuse, smooth_specular: of the terms.
        """
        s = s * dr.exp(self.log_level)
        limits: list[Any] = [dr.opaque(mi.Float, smooth_diffuse / 3)] * 3
        limits.append(dr.opaque(mi.Float, smooth_specular))
        by_diffuse, by_specular = self._climb(e, s, weight, limits)
        forces = self._smoothness_forces()
        pull = image / 3 * weight * self.pull
        # A strong limit is not climbed to faster: the maps could not follow.
        hold: list[Any] = [4 * at_most(limit, 1) for limit in limits]
        pace = _DIFFUSE / (hold[0] + image / 3 * by_diffuse)
        force = mi.Color3f(*forces[:3]) + pull * by_diffuse
        keep = self.settings.unseen_cost * unseen
        moved = _towards(self.diffuse - pace * force, self.begin, pace * keep)
        moved = dr.clip(moved, *self.bounds)
        pace = _SPECULAR / (hold[3] + image / 3 * dr.sum(by_specular))
        by_gloss = dr.sum(pull * by_specular)
        level = self.relative - pace * (forces[3] + by_gloss)
        # The cost of gloss, per unit of log specular albedo at the nominal level.
        nominal, most_specular = gloss.log
        cost = self.settings.specular_cost * dr.exp(nominal)
        cost = cost * weight * dr.mean(mi.Color3f(s))
        level = _towards(level, nominal, pace * cost)
        most = image / 3 * weight * dr.sum(by_specular)
        level += self._of_all(by_gloss, most, cost, self.relative - nominal)
        level = at_most(level, most_specular)
        self.ahead = (2 * moved - self.diffuse, 2 * level - self.relative)
        self.diffuse, self.relative = moved, level
        dr.eval(moved, level, self.ahead)

    def _climb(self, e: Any, s: Any, weight: Any, limits: list[Any]) -> tuple[Any, Any]:
        """The duals' step; derivatives of the encoded image by diffuse and log specular albedo."""
        diffuse, specular = self.ahead
        linear = decode(diffuse) * e + dr.exp(specular) * s
        seen = encode(linear)
        recorded = (seen > UNCLIPPED[0]) & (seen < UNCLIPPED[1])
        slope = dr.select(recorded, encoding_slope(linear), 0)
        by_diffuse = slope * e / encoding_slope(decode(diffuse))
        by_specular = slope * dr.exp(specular) * s
        reach = by_diffuse * _DIFFUSE + by_specular * (_SPECULAR + _LEVEL)
        reach += 0 if self.perturbation is None else _NORMAL
        rise = 1 / (at_least(reach, 1e-4) * at_least(weight, 0.03))
        self.pull = dr.clip(self.pull + rise * (dr.clip(seen, *UNCLIPPED) - self.target), -1, 1)
        right, below = mi.Vector4f(0), mi.Vector4f(0)
        units = (_DIFFUSE, _DIFFUSE, _DIFFUSE, _SPECULAR)
        for k, x in enumerate((*diffuse, specular)):
            pace = at_most(limits[k], 1) / (2 * units[k])
            across = dr.gather(mi.Float, x, self.neighbours.right) - x
            down = dr.gather(mi.Float, x, self.neighbours.below) - x
            right[k] = dr.clip(self.right[k] + pace * across, -limits[k], limits[k])
            below[k] = dr.clip(self.below[k] + pace * down, -limits[k], limits[k])
        self.right, self.below = right, below
        dr.eval(self.pull, right, below, by_diffuse, by_specular)
        return by_diffuse, by_specular

    def _smoothness_forces(self) -> list[Any]:
        """What the differences on all four sides do to each channel: minus their divergence."""
        forces = []
        for right, below in zip(self.right, self.below, strict=True):
            left = dr.gather(mi.Float, right, self.neighbours.left, self.inner[0])
            above = dr.gather(mi.Float, below, self.neighbours.above, self.inner[1])
            forces.append(left + above - right - below)
        return forces

    def _of_all(self, by_gloss: Any, most: Any, cost: Any, away: Any) -> Any:
        """The step that log specular albedo takes as a whole, which smoothness does not hold.

        The steps of single texels have to be so short, for their neighbours, that they would never
        move it. by_gloss, most: the pull of the image on each texel, and the most it can be. away:
        from the nominal level.
        """
        cost = cost * dr.clip(away / _LEVEL, -1, 1)
        share = dr.sum(by_gloss + cost) / dr.fmax(dr.sum(most), 1e-6)
        return -_LEVEL * dr.clip(share, -1, 1)

    def image(self, e: Any, s: Any, weight: Any) -> Any:
        """The image loss as it depends on E and S, each pixel pulling as it does; weight: sum 1."""
        s = s * dr.exp(self.log_level)
        seen = encode(decode(self.ahead[0]) * e + dr.exp(self.ahead[1]) * s)
        return dr.sum(weight * dr.sum(self.pull * dr.clip(seen, *UNCLIPPED))) / 3

    def follow_normals(self, perturbation: Any) -> None:
        """Have the normals follow, too, from `perturbation` (mi.Vector3f) on."""
        self.perturbation = type(perturbation)(dr.detach(perturbation))
        dr.enable_grad(self.perturbation)

    def turn_normals(self, loss: Any, cost: float) -> None:
        """One step down of the perturbation: of `loss`, and of `cost` times its mean square."""
        dr.backward(loss)
        gradient = dr.grad(self.perturbation) * dr.opaque(mi.Float, dr.width(self.perturbation))
        moved = dr.detach(self.perturbation) - _NORMAL * gradient
        self.follow_normals(moved / (1 + 2 * _NORMAL * cost))
        dr.eval(self.perturbation)
