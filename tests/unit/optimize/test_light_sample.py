"""What the sampled pixels tell of all: how a change of the light changes their shading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from unlit.machine.runtime import mitsuba
from unlit.optimize.shading import LightSample, Shading
from unlit.optimize.stage_run import with_unit_light
from unlit.optimize.stages import start
from unlit.scene.arrays import device
from unlit.scene.cells import grid_cells
from unlit.scene.lobes import CellRadiance

mi = mitsuba()


def test_shading_of_all_pixels_follows_the_sample() -> None:
    """Under a light that grew brighter from one side; the sample is a third of the pixels."""
    settings = tiny_run.settings(light_points=80)
    problem = tiny_run.problem(settings, tiny_run.record())
    cells = grid_cells(settings.cell_rows, settings.cell_columns)
    shading = Shading(problem, cells)
    sample = LightSample(problem, shading)
    assert len(sample.rows) < len(problem) / 2

    light = start(problem).light()
    before = CellRadiance(cells).of(light)
    brighter = (light.amplitude * (1 + np.clip(light.axis[:, 0], 0, 1))).astype(np.float32)
    after = CellRadiance(cells).of(replace(light, amplitude=brighter))
    shading.update(before, problem.maps(start(problem)))
    old = [x.numpy() for x in shading.shade(before)]
    sample.hold(shading, *sample.transport.shade(device(mi.Float, before)))
    direct = sample.transport.shade(device(mi.Float, after))
    factors = [x.numpy() for x in sample.changed(*direct)]
    new = [x.numpy() for x in shading.shade(after)]
    for was, factor, now in zip(old, factors, new, strict=True):
        missed, change = np.abs(was * factor - now).mean(), np.abs(now - was).mean()
        assert missed < 0.1 * change

    unchanged = sample.changed(*sample.transport.shade(device(mi.Float, before)))
    for factor in unchanged:
        assert factor.numpy() == pytest.approx(1, abs=1e-4)


def test_the_sample_takes_its_visibility_from_that_of_all() -> None:
    """Once that is traced; traced for itself it is the same, to the bit."""
    settings = tiny_run.settings(light_points=80)
    problem = tiny_run.problem(settings, tiny_run.record())
    shading = Shading(problem, grid_cells(settings.cell_rows, settings.cell_columns))
    index = LightSample(problem, shading).index
    traced = shading.bits_of(index).numpy()
    assert "bits" not in vars(shading)
    assert len(shading.bits) > len(traced) > 0
    np.testing.assert_array_equal(shading.bits_of(index).numpy(), traced)
    assert 0 < np.unpackbits(traced.view(np.uint8)).mean() < 1


def test_light_and_gain_are_judged_where_the_head_is_fitted() -> None:
    """The left half is fitted: what is sampled and called full light lies there."""
    x = np.arange(tiny_run.SIZE) + np.zeros((tiny_run.SIZE, 1))
    left = x < tiny_run.SIZE // 2
    problem = tiny_run.problem(fitted=left)
    assert problem.fitted.any() and not problem.fitted[~left].any()
    shading = Shading(problem, grid_cells(6, 12))
    sample = LightSample(problem, shading)
    assert set(problem.pixel[sample.rows]) == set(np.flatnonzero(problem.fitted))

    estimate = with_unit_light(problem, start(problem), shading)
    shading.update(CellRadiance(shading.cells).of(estimate.light()), problem.maps(estimate))
    e, _ = shading.shade(CellRadiance(shading.cells).of(estimate.light()))
    e = problem.image(e, "zero").mean(axis=-1)
    assert np.percentile(e[problem.fitted], 99) == pytest.approx(1, abs=0.01)


def test_a_head_that_is_nowhere_fitted_is_judged_everywhere() -> None:
    """Or where the photo does not count there."""
    nowhere = np.zeros((tiny_run.SIZE, tiny_run.SIZE), dtype=bool)
    problem = tiny_run.problem(fitted=nowhere)
    np.testing.assert_array_equal(problem.fitted, problem.inside)
    left = np.arange(tiny_run.SIZE) + 0 * nowhere < tiny_run.SIZE // 2
    problem = tiny_run.problem(fitted=left, weight=np.where(left, 0, 1).astype(np.float32))
    np.testing.assert_array_equal(problem.fitted, problem.inside)
