"""The primal-dual solver of the maps: its minimum, its rest, its derivatives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest

from unlit.color import encode_srgb
from unlit.machine.runtime import mitsuba
from unlit.optimize.gloss_level import GlossLevel
from unlit.optimize.losses import Neighbours, encode, gloss_l1, image_l1, total_variation
from unlit.optimize.optimizer import Adam
from unlit.optimize.primal_dual import PrimalDual, decode, encoding_slope
from unlit.settings.settings import Settings

mi = mitsuba()

SIDE = 24
#: Nothing is in the dark.
SEEN = 0.0
#: Of the image, and of the smoothness of diffuse and specular albedo.
TERMS = (1.0, 3.0, 20.0)


class Patch:
    """A noisy square of two colours under a known shading, and the loss of its maps."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        count = SIDE * SIDE
        colour = np.where(np.arange(count)[:, None] % SIDE < SIDE // 2, 0.5, 0.35)
        colour = colour * [1, 0.8, 0.7] + rng.uniform(0, 0.03, (count, 3))
        e, s = np.linspace(0.4, 1, count)[:, None] * [1, 1, 1], rng.uniform(0, 0.1, (count, 3))
        self.e, self.s = (mi.Color3f(np.ascontiguousarray(x.T)) for x in (e, s))
        self.target = mi.Color3f(np.ascontiguousarray(encode_srgb(colour * e + s).T))
        self.neighbours = Neighbours.of(np.arange(count), SIDE, SIDE)
        self.count, self.settings = count, Settings()

    def state(self) -> dict[str, Any]:
        n = self.count
        still = {"pull": dr.zeros(mi.Color3f, n)}
        still |= {name: dr.zeros(mi.Vector4f, n) for name in ("right", "below")}
        level = dr.full(mi.Float, np.log(0.3), n)
        return {"log_diffuse": mi.Color3f(level), "log_specular": level, **still}

    def solver(self) -> PrimalDual:
        return PrimalDual(self.neighbours, self.target, self.settings, self.state())

    def loss(self, log_diffuse: Any, log_specular: Any) -> Any:
        image, diffuse, specular = TERMS
        weight = dr.full(mi.Float, 1 / self.count, self.count)
        rendered = dr.exp(log_diffuse) * self.e + dr.exp(log_specular) * self.s
        loss = image * image_l1(rendered, self.target, weight)
        loss += diffuse * total_variation(encode(dr.exp(log_diffuse)), self.neighbours)
        loss += specular * total_variation(log_specular, self.neighbours)
        nominal, cost = self.settings.nominal_specular, self.settings.specular_cost
        return loss + cost * gloss_l1(log_specular, nominal, self.s, weight)

    def value(self, solver: PrimalDual) -> float:
        return float(self.loss(solver.log_diffuse, solver.log_specular).numpy().item())


def run(patch: Patch, solver: PrimalDual, steps: int) -> list[float]:
    """The loss before the first step and after each."""
    weight = dr.full(mi.Float, 1.0, patch.count)
    values = [patch.value(solver)]
    for _ in range(steps):
        solver.step(patch.e, patch.s, weight, SEEN, GlossLevel.of(patch.settings), *TERMS)
        values.append(patch.value(solver))
    return values


def test_what_is_not_seen_stays_as_it_was(patch: Patch) -> None:
    """Where the photo says nothing but smoothness pulls, and only there."""
    patch = Patch()
    start = patch.state()
    dark = np.arange(patch.count) % SIDE < SIDE // 2
    for cost in (1.0, 0.0):
        patch.settings = replace(patch.settings, unseen_cost=cost)
        solver = PrimalDual(patch.neighbours, patch.target, patch.settings, start)
        weight = mi.Float(np.where(dark, 0.0, 2.0).astype(np.float32))
        unseen = mi.Float(dark.astype(np.float32))
        for _ in range(300):
            solver.step(patch.e, patch.s, weight, unseen, GlossLevel.of(patch.settings), *TERMS)
        albedo = np.exp(solver.log_diffuse.numpy())
        assert np.abs(albedo[:, ~dark] - 0.3).max() > 0.02
        moved = np.abs(albedo[:, dark] - 0.3).max()
        assert moved < 1e-3 if cost else moved > 0.01


@pytest.fixture(scope="module")
def patch() -> Patch:
    return Patch()


def test_it_ends_below_adam_in_a_tenth_of_the_steps(patch: Patch) -> None:
    """Adam with decaying rates, 2000 steps, does not come down to where 200 of these do.

    (Half as far again: it hardly moves the level of gloss.) After 1000 little is left to gain.
    """
    start = patch.state()
    adam = Adam(
        {name: start[name] for name in ("log_diffuse", "log_specular")},
        {"log_diffuse": 0.05, "log_specular": 0.05},
        *(2000, 0.3, 0.0, 1.0),
    )
    for _ in range(2000):
        loss = patch.loss(adam["log_diffuse"], adam["log_specular"])
        dr.backward(loss)
        adam.step()
    best = float(loss.numpy().item())
    values = run(patch, patch.solver(), 2000)
    assert values[200] < best / 1.5
    assert values[1000] < 1.02 * values[-1]


def test_at_the_solution_it_rests(patch: Patch) -> None:
    """Gone on with from what it holds, it is not thrown; without its duals it is."""
    solver = patch.solver()
    last = run(patch, solver, 1000)[-1]
    kept = {name: getattr(solver, name) for name in PrimalDual.STATE}
    on = PrimalDual(patch.neighbours, patch.target, patch.settings, kept)
    assert max(run(patch, on, 20)) < 1.03 * last
    maps = {name: kept[name] for name in ("log_diffuse", "log_specular")}
    anew = PrimalDual(patch.neighbours, patch.target, patch.settings, patch.state() | maps)
    assert max(run(patch, anew, 20)) > 1.1 * last


def test_gain_leaves_the_image(patch: Patch) -> None:
    solver = patch.solver()
    run(patch, solver, 50)
    before = [dr.exp(solver.log_diffuse).numpy(), dr.exp(solver.log_specular).numpy()]
    solver.brighten(0.2)
    after = [dr.exp(solver.log_diffuse).numpy(), dr.exp(solver.log_specular).numpy()]
    for old, new in zip(before, after, strict=True):
        assert new == pytest.approx(np.exp(0.2) * old, rel=1e-3)


def test_shading_is_followed_by_the_pulls(patch: Patch) -> None:
    """The derivative of `image` by E is the pull times that of the encoded render."""
    solver = patch.solver()
    run(patch, solver, 30)
    weight = dr.full(mi.Float, 1 / patch.count, patch.count)
    e = mi.Color3f(patch.e)
    dr.enable_grad(e)
    dr.backward(solver.image(e, patch.s, weight))
    step = 1e-3
    rho, gloss = decode(solver.ahead[0]), dr.exp(solver.ahead[1])
    higher, lower = (encode(rho * (patch.e + d) + gloss * patch.s) for d in (step, -step))
    expected = solver.pull * (higher - lower) / (2 * step) / 3 / patch.count
    assert dr.grad(e).numpy() == pytest.approx(expected.numpy(), abs=2e-3 / patch.count)


def test_gloss_that_nothing_asks_for_goes_to_the_nominal_level(patch: Patch) -> None:
    """And stays there; in the dark, where it costs nothing, it stays where it is."""
    weight = dr.full(mi.Float, 1.0, patch.count)
    for s, level in ((0.0, 0.3), (0.05, patch.settings.nominal_specular)):
        solver = patch.solver()
        gloss = mi.Color3f(s)
        for _ in range(1500):
            # The photo is what is rendered, whatever that is.
            solver.target = encode(decode(solver.ahead[0]) * patch.e + dr.exp(solver.ahead[1]) * s)
            solver.step(patch.e, gloss, weight, SEEN, GlossLevel.of(patch.settings), *TERMS)
        assert np.exp(solver.log_specular.numpy()) == pytest.approx(level, rel=1e-3)


def test_decoding_undoes_encoding() -> None:
    linear = mi.Float(np.geomspace(1e-4, 3, 200, dtype=np.float32))
    assert decode(encode(linear)).numpy() == pytest.approx(linear.numpy(), rel=1e-3)
    step = 1e-3 * linear
    slope = (encode(linear + step) - encode(linear - step)) / (2 * step)
    away = np.abs(linear.numpy() - 0.0031308) > 1e-4
    found = encoding_slope(linear).numpy()[away]
    assert found == pytest.approx(slope.numpy()[away], rel=5e-3)
