"""What the stages share: one stage's bookkeeping, and the terms that several of them minimise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..scene.lobes import CellRadiance
from ..settings.settings import Settings
from ..settings.table1 import Stage
from .estimate import Estimate
from .losses import encode, gloss_l1, image_l1, total_variation
from .optimizer import Adam
from .problem import Problem
from .shading import LightSample, Shading

mi = mitsuba()

#: Iterations between two reports of the loss; reading it more often would stall the device.
REPORT = 25


class StageRun:
    """The bookkeeping of one stage: its optimiser and its report."""

    def __init__(
        self,
        problem: Problem,
        name: str,
        parameters: dict[str, Any],
        rates: dict[str, float],
        uniform: frozenset[str] = frozenset(),
    ) -> None:
        self.problem, self.name = problem, name
        self.settings: Settings = problem.settings
        self.stage: Stage = getattr(problem.settings, name)
        self.adam = Adam(
            parameters,
            rates,
            self.stage.iterations,
            self.settings.rate_hold,
            self.settings.rate_floor,
            self.settings.clip,
            uniform,
        )

    def step(self, iteration: int, loss: Any, light_loss: Any = None) -> None:
        """Back-propagate, take one step, keep the parameters in range, report `loss`.

        light_loss: a further loss, of parameters that `loss` does not depend on.
        """
        adam, settings = self.adam, self.settings
        dr.backward(loss if light_loss is None else loss + light_loss)
        adam.step()
        if "axis" in adam.rates:
            adam["axis"] = dr.normalize(adam["axis"])
        if "log_sharpness" in adam.rates:
            low, high = np.log(settings.min_sharpness), np.log(settings.max_sharpness)
            adam["log_sharpness"] = dr.clip(adam["log_sharpness"], low, high)
        adam["log_specular"] = dr.fmin(adam["log_specular"], np.log(settings.max_specular))
        adam["log_diffuse"] = dr.fmin(adam["log_diffuse"], np.log(settings.max_diffuse))
        iterations = self.stage.iterations
        if iteration % REPORT == 0 or iteration == iterations - 1:
            value = float(loss.numpy().item())
            self.problem.report(self.name, iteration + 1, iterations, value)

    def normalize_light(self, e: Any) -> None:
        """Fix the gain between light and albedo by the diffuse shading E, as `with_unit_light`."""
        shift = float(np.log(brightest(e)))
        for name, sign in (("log_diffuse", 1), ("log_specular", 1), ("log_amplitude", -1)):
            self.adam[name] = dr.detach(self.adam[name]) + dr.opaque(mi.Float, sign * shift)

    def result(self, estimate: Estimate, *names: str) -> Estimate:
        """`estimate` with the named parameters as they are now."""
        return replace(estimate, **{name: dr.detach(self.adam[name]) for name in names})


def light_parameters(estimate: Estimate) -> dict[str, Any]:
    """The lobes' parameters, by their names in Adam."""
    return {name: getattr(estimate, name) for name in ("axis", "log_sharpness", "log_amplitude")}


def light_rates(stage: Stage) -> dict[str, float]:
    """Their rates, the last columns of Table 1."""
    return {
        "axis": stage.axis_rate,
        "log_sharpness": stage.sharpness_rate,
        "log_amplitude": stage.amplitude_rate,
    }


def radiance_of(cell_radiance: CellRadiance, adam: Adam) -> Any:
    """Mean radiance of each cell (mi.Float, D) under the lobes as they are."""
    return cell_radiance(
        dr.normalize(adam["axis"]), dr.exp(adam["log_sharpness"]), dr.exp(adam["log_amplitude"])
    )


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
    specular = stage.specular_smoothness * total_variation(log_specular, problem.neighbours)
    diffuse *= settings.diffuse_smoothness_scale
    specular *= settings.specular_smoothness_scale
    return unit * (diffuse + specular)


def gloss_loss(settings: Settings, log_specular: Any, s: Any, weight: Any) -> Any:
    """Of two explanations that fit alike, the one with the gloss of plain skin."""
    return settings.specular_cost * gloss_l1(log_specular, settings.nominal_specular, s, weight)


def map_loss(
    problem: Problem,
    stage: Stage,
    adam: Adam,
    e: Any,
    s: Any,
    weight: Any,
    smoothness: float = 1.0,
) -> Any:
    """What stages 2 to 5 ask of the albedo maps: the image, smoothness, plain gloss."""
    image = rendered(adam["log_diffuse"], adam["log_specular"], e, s)
    loss = stage.image * image_l1(image, problem.target, weight)
    loss += smoothness_loss(stage, problem, adam["log_diffuse"], adam["log_specular"], smoothness)
    return loss + gloss_loss(problem.settings, adam["log_specular"], s, weight)


def trusted(problem: Problem, e: Any) -> Any:
    """Weight of each pixel in the maps' loss, sum 1: its own times (E / (E + error))^2."""
    level = dr.mean(dr.detach(e))
    weight = problem.weight * dr.square(
        level / dr.fmax(level + problem.settings.shading_error, 1e-6)
    )
    weight /= dr.sum(weight)
    dr.eval(weight)
    return weight


def light_loss(sample: LightSample, shading: Shading, adam: Adam, e: Any, s: Any) -> Any:
    """Image loss of the sampled pixels as a function of the light alone, the maps as they are."""
    image = rendered(
        sample.of(dr.detach(adam["log_diffuse"])),
        sample.of(dr.detach(adam["log_specular"])),
        e + sample.of(shading.indirect[0]),
        s + sample.of(shading.indirect[1]),
    )
    return image_l1(image, sample.target, sample.weight)


def with_unit_light(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Fix the gain between light and albedo, which the image hardly tells.

    Convention: the best-lit skin (99th percentile of the diffuse shading E) has E = 1, as if the
    photo were exposed for a white card held there. Albedo is then what the photo shows where the
    light is full. Inter-reflection and the result take less (face/gain.py).
    """
    radiance = CellRadiance(shading.cells).of(estimate.light())
    shading.update(radiance, problem.maps(estimate))
    e, _ = shading.shade(radiance)
    return estimate.with_gain(brightest(e))


def brightest(e: Any) -> float:
    """The diffuse shading E of the best-lit skin."""
    return float(np.percentile(dr.mean(dr.detach(e)).numpy(), 99))
