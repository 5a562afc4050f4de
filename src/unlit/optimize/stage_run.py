"""What the stages share: one stage's bookkeeping, and the terms that several of them minimise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..perception.regions import REGIONS
from ..scene.arrays import at_most, device
from ..scene.lobes import CellRadiance
from ..settings.settings import Settings
from ..settings.table1 import Stage
from .estimate import Estimate
from .gloss_level import GlossLevel
from .light_steps import LightSteps
from .losses import encode, gloss_l1, image_l1, total_variation
from .optimizer import Adam
from .primal_dual import PrimalDual
from .problem import Problem
from .shading import LightSample, Shading

mi = mitsuba()

_SURE_OF_EYES = 0.8
#: Iterations between two reports of the loss; reading it more often would stall the device.
REPORT = 25


class StageRun:
    """The bookkeeping of one stage: its optimisers and its report.

    light: None where it is fixed. parameters, rates, uniform: of Adam, besides the light's. solver:
    of what Adam does not hold, if there is one.
    """

    def __init__(
        self,
        problem: Problem,
        name: str,
        light: LightSteps | None,
        parameters: dict[str, Any],
        rates: dict[str, float],
        uniform: frozenset[str] = frozenset(),
        solver: PrimalDual | None = None,
    ) -> None:
        self.problem, self.name, self.light, self.solver = problem, name, light, solver
        self.settings: Settings = problem.settings
        self.stage: Stage = getattr(problem.settings, name)
        self.gloss = GlossLevel.of(self.settings)
        #: Whether the loss has stopped changing.
        self.converged = False
        self._reported: float | None = None
        self.adam = Adam.of(self.settings, parameters, rates, self.stage.iterations, uniform)

    @staticmethod
    def of_maps(
        problem: Problem,
        name: str,
        estimate: Estimate,
        light: LightSteps | None,
        others: dict[str, Any],
        rates: dict[str, float],
        uniform: frozenset[str] = frozenset(),
    ) -> StageRun:
        """Of a stage with albedo maps; others, rates: what it has besides, and Adam's rates."""
        settings = problem.settings
        if settings.solver == "adam":
            maps = {
                "log_diffuse": estimate.log_diffuse,
                "log_specular": estimate.log_specular,
            }
            stage: Stage = getattr(settings, name)
            rates = rates | dict.fromkeys(maps, stage.rate)
            return StageRun(problem, name, light, others | maps, rates, uniform)
        state = {field: getattr(estimate, field) for field in PrimalDual.STATE}
        solver = PrimalDual(problem.neighbours, problem.target, settings, state, problem.log_level)
        return StageRun(problem, name, light, others, rates, uniform, solver)

    def __getitem__(self, name: str) -> Any:
        return self.adam[name] if name in self.adam.values else getattr(self.solver, name)

    def step(self, loss: Any) -> None:
        """Back-propagate, let Adam take one step, keep its parameters in range."""
        adam, settings = self.adam, self.settings
        if dr.grad_enabled(loss):  # not where all that it depends on has a rate of 0
            dr.backward(loss)
        adam.step()
        if self.solver is None:
            adam["log_specular"] = at_most(adam["log_specular"], self.gloss.log[1])
            adam["log_diffuse"] = at_most(adam["log_diffuse"], np.log(settings.max_diffuse))

    def report(self, iteration: int, loss: Callable[[], Any]) -> None:
        """Report the loss every so often, and see whether it still changes."""
        iterations = self.stage.iterations
        if iteration % REPORT == 0 or iteration == iterations - 1:
            value = float(loss().numpy().item())
            least = self.settings.tolerance
            if least and self._reported is not None:
                self.converged = abs(value - self._reported) < least * self._reported
            self._reported = value
            self.problem.report(self.name, iteration + 1, iterations, value)

    def judge_gloss(self, s: Any, weakest: Any) -> None:
        """Bound gloss by what the weakest channel of the photo leaves under the shading S."""
        self.gloss = GlossLevel.of(self.settings, s, weakest)

    def normalize_light(self, e: Any) -> None:
        """Fix the gain between light and albedo by the diffuse shading E, as `with_unit_light`."""
        shift = float(np.log(brightest(e)))
        if self.light is not None:
            self.light.brighten(-shift)
        if self.solver is not None:
            self.solver.brighten(shift)
        for name in ("log_diffuse", "log_specular"):
            if name in self.adam.values:
                self.adam[name] = dr.detach(self.adam[name]) + dr.opaque(mi.Float, shift)

    def result(self, estimate: Estimate, *names: str) -> Estimate:
        """`estimate` with the named parameters, the light and what the solver holds, as it is."""
        names += () if self.solver is None else PrimalDual.STATE
        lobes = {} if self.light is None else self.light.lobes()
        return replace(estimate, **lobes, **{name: dr.detach(self[name]) for name in names})

    def map_loss(self, e: Any, s: Any, weight: Any) -> Any:
        """What stages 2 to 5 ask of the albedo maps: the image, smoothness, plain gloss."""
        problem, stage = self.problem, self.stage
        log_diffuse, log_specular = self["log_diffuse"], self["log_specular"]
        image = rendered(log_diffuse, log_specular, e, s)
        loss = stage.image * image_l1(image, problem.target, weight)
        loss += smoothness_loss(stage, problem, log_diffuse, log_specular, self._detail)
        relative, s = log_specular - problem.log_level, s * dr.exp(problem.log_level)
        return loss + gloss_loss(problem.settings, self.gloss, relative, s, weight)

    def loss_after_maps(self, e: Any, s: Any, weight: Any) -> Any:
        """What mesh and normals are to go down of, as a function of the shading E, S.

        The primal-dual solver has the maps take their step first; Adam moves them with the rest.
        """
        if self.solver is None:
            return self.map_loss(e, s, weight)
        settings, stage = self.settings, self.stage
        unit = self._detail * self.problem.camera.width / 512
        now = dr.detach(e), dr.detach(s)
        unseen = 1 - trust(now[0], settings.shading_error * self._doubt)
        self.solver.step(
            *now,
            weight * len(self.problem),
            unseen,
            self.gloss,
            stage.image,
            unit * stage.diffuse_smoothness * settings.diffuse_smoothness_scale,
            unit * stage.specular_smoothness * settings.specular_smoothness_scale,
        )
        return stage.image * self.solver.image(e, s, weight)

    @property
    def shading_error(self) -> Any:
        """Error of E that the maps expect of their image loss, a float or mi.Float."""
        if self.name != "stage5":
            return self.settings.shading_error
        return self.settings.detail_shading_error * self._doubt

    @cached_property
    def _doubt(self) -> Any:
        """Factor on the error: in stage 5 less in the eyes, which lids shade.

        White and pupil differ by far more than the shading is wrong.
        """
        if self.name != "stage5":
            return 1.0
        eyes = self.problem.regions[:, REGIONS.index("eyes")]
        return device(mi.Float, 1 - _SURE_OF_EYES * eyes)

    @property
    def _detail(self) -> float:
        return self.settings.detail_smoothness if self.name == "stage5" else 1.0


def rendered(log_diffuse: Any, log_specular: Any, e: Any, s: Any) -> Any:
    """I = rho_d E + rho_s S, mi.Color3f."""
    return dr.exp(log_diffuse) * e + dr.exp(log_specular) * s


def smoothness_loss(
    stage: Stage, problem: Problem, log_diffuse: Any, log_specular: Any, scale: float
) -> Any:
    """Smoothness of both albedo maps per texel (section 3.2), the same at every resolution."""
    settings = problem.settings
    # The difference of neighbours falls as 1 / resolution.
    unit = dr.opaque(mi.Float, scale * problem.camera.width / 512)
    seen = encode(dr.exp(log_diffuse))
    diffuse = stage.diffuse_smoothness * total_variation(seen, problem.neighbours)
    specular = stage.specular_smoothness * total_variation(
        log_specular - problem.log_level, problem.neighbours
    )
    diffuse *= settings.diffuse_smoothness_scale
    specular *= settings.specular_smoothness_scale
    return unit * (diffuse + specular)


def gloss_loss(
    settings: Settings, gloss: GlossLevel, log_specular: Any, s: Any, weight: Any
) -> Any:
    """Of two explanations that fit alike, the one with the gloss of plain skin.

    log_specular, s: where regions have levels, what the map has over them, and S times them.
    """
    return settings.specular_cost * gloss_l1(log_specular, dr.exp(gloss.log[0]), s, weight)


def trust(e: Any, error: Any) -> Any:
    """How much a pixel of shading E says about its albedo, 0 to 1."""
    level = dr.mean(dr.detach(e))
    return dr.square(level / dr.fmax(level + error, 1e-6))


def trusted(problem: Problem, e: Any, error: Any) -> Any:
    """Weight of each pixel in the maps' loss, sum 1: its own times (E / (E + error))^2."""
    weight = problem.weight * trust(e, error)
    weight /= dr.sum(weight)
    dr.eval(weight)
    return weight


def light_loss(
    sample: LightSample, shading: Shading, run: StageRun, shade: Callable[[Any], tuple[Any, Any]]
) -> Callable[[Any], Any]:
    """Image loss of the sample as a function of the cells' radiance, with the maps as they are.

    shade: the sample's direct E and S under a radiance.
    """
    names = ("log_diffuse", "log_specular")
    maps = [sample.of(dr.detach(run[name])) for name in names]
    indirect = [sample.of(x) for x in shading.indirect]
    dr.eval(maps, indirect)

    def loss(radiance: Any) -> Any:
        e, s = shade(radiance)
        image = rendered(maps[0], maps[1], e + indirect[0], s + indirect[1])
        return run.stage.image * image_l1(image, sample.target, sample.weight)

    return loss


def with_unit_light(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Fix the gain between light and albedo, which the image hardly tells.

    Convention: the best-lit skin (99th percentile of the diffuse shading E) has E = 1, as if the
    photo were exposed for a white card held there. Albedo is then what the photo shows where the
    light is full. Inter-reflection and the result take less (face/gain.py).
    """
    radiance = CellRadiance(shading.cells).of(estimate.light())
    shading.update(radiance, problem.maps(estimate))
    e, _ = shading.shade(radiance)
    fitted = device(mi.UInt32, problem.fitted_rows)
    return estimate.with_gain(brightest(dr.gather(type(e), e, fitted)))


def brightest(e: Any) -> float:
    """The diffuse shading E of the best-lit skin."""
    return float(np.percentile(dr.mean(dr.detach(e)).numpy(), 99))
