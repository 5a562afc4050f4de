"""The steps by which the light of a stage follows a loss."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest

import tiny_run
from unlit.machine.runtime import mitsuba
from unlit.optimize.light_steps import LightSteps
from unlit.optimize.stages import start
from unlit.scene.cells import grid_cells
from unlit.settings.table1 import Stage

mi = mitsuba()

CELLS = grid_cells(6, 8)


def light(stage: Stage, steps: int) -> LightSteps:
    settings = tiny_run.settings()
    estimate = start(tiny_run.problem(settings, tiny_run.record()))
    return LightSteps(settings, stage, estimate, CELLS, steps)


def loss(radiance: Any) -> Any:
    """Least where the light comes from cell 0 alone."""
    bright = dr.arange(mi.UInt32, dr.width(radiance)) == 0
    return dr.sum(dr.square(radiance - dr.select(bright, 20, 0)))


def test_steps_of_one_call_are_steps_of_many() -> None:
    stage = Stage(1, axis_rate=0.01, sharpness_rate=0.05, amplitude_rate=0.05)
    once, often = light(stage, steps=3), light(replace(stage, iterations=3), steps=1)
    begin = float(loss(once.known).numpy().item())
    once.follow(loss)
    for _ in range(3):
        often.follow(loss)
    for name, values in once.lobes().items():
        np.testing.assert_array_equal(values.numpy(), often.lobes()[name].numpy(), err_msg=name)
    assert float(loss(once.known).numpy().item()) < 0.95 * begin
    np.testing.assert_allclose(dr.norm(once.lobes()["axis"]).numpy(), 1, atol=1e-5)


def test_without_rates_nothing_moves() -> None:
    fixed = light(Stage(1), steps=2)
    before = fixed.known.numpy()
    fixed.follow(loss)
    np.testing.assert_array_equal(fixed.known.numpy(), before)


def test_brighten_scales_the_radiance() -> None:
    moving = light(Stage(1, amplitude_rate=0.05), steps=1)
    before = moving.known.numpy()
    moving.brighten(0.5)
    assert moving.known.numpy() == pytest.approx(before * np.exp(0.5), rel=1e-5)
