"""The stages one by one, on a head of a few hundred pixels: what each changes, and what not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import tiny_run
from unlit.machine.runtime import mitsuba
from unlit.optimize import shading as shading_module
from unlit.optimize.estimate import Estimate
from unlit.optimize.run_record import RunRecord
from unlit.optimize.shading import Shading
from unlit.optimize.stage1_base_color import stage1
from unlit.optimize.stage2_albedo import stage2
from unlit.optimize.stage3_shape import stage3
from unlit.optimize.stage4_normals import stage4, stage5
from unlit.optimize.stage_run import REPORT, StageRun, brightest, with_unit_light
from unlit.optimize.stages import start
from unlit.scene.cells import grid_cells
from unlit.scene.lobes import CellRadiance
from unlit.settings.settings import Settings

mi = mitsuba()

LIGHT = {"axis", "log_sharpness", "log_amplitude"}
ALBEDO = {"log_diffuse", "log_specular"}
#: What only the primal-dual solver uses.
PULLS = {"pull", "right", "below"}
#: What each stage optimises.
UNKNOWNS = {
    "stage1": LIGHT | ALBEDO,
    "stage2": LIGHT | ALBEDO,
    "stage3": LIGHT | ALBEDO | {"vertices"},
    "stage4": ALBEDO | {"perturbation"},
    "stage5": ALBEDO | {"perturbation"},
}


@dataclass(frozen=True)
class Stages:
    """Estimates, as arrays by name, before the first stage (under "start") and after each."""

    estimates: dict[str, dict[str, np.ndarray]]
    record: RunRecord
    colors: int
    pulls: bool

    def pairs(self) -> Iterator[tuple[str, dict[str, np.ndarray], dict[str, np.ndarray]]]:
        names = list(self.estimates)
        for before, after in pairwise(names):
            yield after, self.estimates[before], self.estimates[after]


def chosen() -> Settings:
    """Rates at which so few iterations do not go past their aim."""
    settings = replace(tiny_run.settings(), refresh_interval=20)
    stages = {
        f"stage{k}": replace(getattr(settings, f"stage{k}"), iterations=40, rate=0.002)
        for k in range(1, 6)
    }
    return replace(settings, **stages)


@pytest.fixture(scope="module", params=["adam", "primal-dual"])
def stages(request: pytest.FixtureRequest) -> Stages:
    settings, record = replace(chosen(), solver=request.param), tiny_run.record()
    problem = tiny_run.problem(settings, record)
    shading = Shading(problem, grid_cells(settings.cell_rows, settings.cell_columns))
    found: dict[str, dict[str, np.ndarray]] = {}

    def kept(name: str, estimate: Estimate) -> Estimate:
        found[name] = estimate.arrays()
        return estimate

    estimate = kept("start", start(problem))
    estimate = kept("stage1", stage1(problem, estimate, shading))
    estimate = kept("stage2", stage2(problem, estimate, shading))
    estimate, shading = stage3(problem, estimate, shading)
    kept("stage3", estimate)
    estimate = kept("stage4", stage4(problem, estimate, shading))
    kept("stage5", stage5(problem, estimate, shading))
    regions = problem.regions.max(axis=1) == 1
    colors = len(np.unique(np.round(found["stage1"]["log_diffuse"][regions], 5), axis=0))
    return Stages(found, record, colors, request.param == "primal-dual")


@pytest.mark.parametrize("stage", UNKNOWNS)
def test_its_loss_falls(stages: Stages, stage: str) -> None:
    """It is told at the first iteration, every 25 and at the last.

    The primal-dual solver leaves stages 3 and 4 little to do for the maps.
    """
    iterations, losses = zip(*stages.record.losses[stage], strict=True)
    assert iterations == (0, 25, 39)
    near = stages.pulls and stage in ("stage3", "stage4")
    assert losses[-1] < (0.995 if near else 0.97) * losses[0]


def test_each_changes_its_unknowns_only(stages: Stages) -> None:
    """The mesh moves in stage 3, the light stays after it, normals are bent from stage 4 on."""
    for stage, before, after in stages.pairs():
        changed = {name for name in before if not np.array_equal(before[name], after[name])}
        assert changed - PULLS == UNKNOWNS[stage], stage
        assert changed & PULLS == (PULLS if stages.pulls and stage != "stage1" else set()), stage


def test_stage_1_has_one_colour_by_region(stages: Stages) -> None:
    """Skin and lips are all that the tiny head has; in between they are blended."""
    assert stages.colors == 2


def test_stage_3_moves_the_mesh_a_little(stages: Stages) -> None:
    moved = np.linalg.norm(
        stages.estimates["stage3"]["vertices"] - stages.estimates["stage2"]["vertices"], axis=1
    )
    assert 1e-5 < moved.max() < 0.1  # cm


def test_bends_are_small_and_the_maps_in_range(stages: Stages) -> None:
    last, settings = stages.estimates["stage5"], chosen()
    assert 1e-4 < np.linalg.norm(last["perturbation"], axis=1).max() < 0.5
    assert last["log_diffuse"].max() <= np.float32(np.log(settings.max_diffuse))
    assert last["log_specular"].max() <= np.float32(np.log(settings.max_specular))
    np.testing.assert_allclose(np.linalg.norm(last["axis"], axis=1), 1, atol=1e-5)
    assert all(np.isfinite(values).all() for values in last.values())


def test_a_stage_without_iterations_leaves_the_estimate() -> None:
    settings = tiny_run.settings()
    off = replace(settings, stage4=replace(settings.stage4, iterations=0))
    problem = tiny_run.problem(off)
    shading = Shading(problem, grid_cells(off.cell_rows, off.cell_columns))
    begin = start(problem)
    after = stage4(problem, begin, shading).arrays()
    for name, values in begin.arrays().items():
        np.testing.assert_array_equal(after[name], values, err_msg=name)


@pytest.mark.parametrize("solver", ["adam", "primal-dual"])
def test_a_light_of_no_rate_stays(solver: str) -> None:
    """But for its gain. With the primal-dual solver Adam then has nothing to move at all."""
    frozen = {"axis_rate": 0.0, "sharpness_rate": 0.0, "amplitude_rate": 0.0}
    settings = replace(tiny_run.settings(), solver=solver)
    settings = replace(settings, stage2=replace(settings.stage2, iterations=3, **frozen))
    problem = tiny_run.problem(settings)
    shading = Shading(problem, grid_cells(settings.cell_rows, settings.cell_columns))
    begin = start(problem)
    after = stage2(problem, begin, shading).arrays()
    for name in ("axis", "log_sharpness"):
        np.testing.assert_array_equal(after[name], begin.arrays()[name])
    assert np.ptp(after["log_amplitude"] - begin.arrays()["log_amplitude"]) < 1e-5
    assert not np.array_equal(after["log_diffuse"], begin.arrays()["log_diffuse"])


def test_a_colour_of_no_rate_leaves_stage_1_its_light() -> None:
    settings = tiny_run.settings()
    settings = replace(settings, stage1=replace(settings.stage1, iterations=2, rate=0.0))
    problem = tiny_run.problem(settings)
    shading = Shading(problem, grid_cells(settings.cell_rows, settings.cell_columns))
    begin = start(problem)
    after = stage1(problem, begin, shading).arrays()
    assert np.ptp(after["log_amplitude"] - begin.arrays()["log_amplitude"]) > 1e-3
    assert np.ptp(after["log_specular"]) < 1e-5  # one colour, but for its gain


@pytest.mark.parametrize(
    ("losses", "ends"),
    [((1, 1.006), False), ((1, 0.99), False), ((1, 1.004), True), ((0, 0), False)],
)
def test_a_stage_ends_when_its_loss_stays(losses: tuple[float, float], ends: bool) -> None:
    """It goes on where the loss rises: something has been upset that will come down again."""
    problem = tiny_run.problem(replace(tiny_run.settings(), tolerance=0.005))
    run = StageRun(problem, "stage1", None, {}, {})
    for k, loss in enumerate(losses):
        run.report(k * REPORT, lambda loss=loss: mi.Float(loss))
    assert run.converged == ends


def test_a_preview_traces_nothing_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it asks for is what the next stage, or the result, needs."""
    traced: list[int] = []
    true = shading_module.visibility

    def counted(*args: Any) -> Any:
        traced.append(1)
        return true(*args)

    monkeypatch.setattr(shading_module, "visibility", counted)
    tiny_run.run()
    alone, traced[:] = len(traced), []
    tiny_run.run(preview=lambda *_: None)
    assert len(traced) == alone


def test_with_unit_light_the_best_lit_skin_has_full_light() -> None:
    """The picture stays: albedo gives up what the light takes."""
    settings = tiny_run.settings(bounces=0)
    problem = tiny_run.problem(settings)
    shading = Shading(problem, grid_cells(settings.cell_rows, settings.cell_columns))
    begin = start(problem).with_gain(2.0)
    before = shading.shade(CellRadiance(shading.cells).of(begin.light()))[0]
    after = with_unit_light(problem, begin, shading)
    e, _ = shading.shade(CellRadiance(shading.cells).of(after.light()))
    assert brightest(before) == pytest.approx(0.5, rel=0.01)
    assert brightest(e) == pytest.approx(1, rel=1e-4)
    gain = np.exp(after.arrays()["log_diffuse"] - begin.arrays()["log_diffuse"])
    np.testing.assert_allclose(gain, brightest(before), rtol=1e-4)
