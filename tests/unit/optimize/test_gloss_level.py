"""The level of gloss, and the most that a photo leaves room for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from unlit.machine.runtime import mitsuba
from unlit.optimize.gloss_level import GlossLevel
from unlit.settings.settings import Settings

mi = mitsuba()


def test_without_a_photo_it_is_the_settings() -> None:
    level = GlossLevel.of(Settings())
    assert (level.nominal, level.most) == (1.0, 20.0)


@pytest.mark.parametrize("brightness", [1.0, 0.25])
def test_gloss_leaves_something_of_the_weakest_channel(brightness: float) -> None:
    """Of half the pixels at least the rest of `gloss_share`, however bright the photo is."""
    rng = np.random.default_rng(0)
    weakest = brightness * rng.uniform(0.01, 0.03, 1001).astype(np.float32)
    s = rng.uniform(0.03, 0.06, 1001).astype(np.float32)
    settings = replace(Settings(), gloss_share=0.5)
    level = GlossLevel.of(settings, mi.Float(s), mi.Float(weakest))
    assert level.nominal == level.most < 1
    assert np.median(level.most * s / weakest) == pytest.approx(0.5, rel=0.05)
    nominal, most = level.log
    assert nominal.numpy() == most.numpy() == pytest.approx(np.log(level.most))


def test_where_the_photo_leaves_room_the_nominal_level_stays() -> None:
    level = GlossLevel.of(Settings(), mi.Color3f(0.05), mi.Float([0.3] * 5))
    assert level.nominal == 1
    assert level.most == pytest.approx(0.6 * 0.3 / 0.05)


def test_the_specular_map_stays_below_it() -> None:
    """A face without blue: whatever the solver, its blue is not all gloss."""
    seen = tiny_run.photo()
    yellow = replace(seen, image=seen.image * np.array([1, 0.8, 0.05], np.float32))
    for solver in ("adam", "primal-dual"):
        made = tiny_run.run(chosen=tiny_run.settings(solver=solver), known=tiny_run.steps(yellow))
        inside = made.face.mask > 0.5
        gloss = made.face.maps.specular_albedo[..., None] * made.images.specular_shading
        share = np.median(gloss[inside][:, 2] / made.images.render[inside][:, 2])
        assert share < 0.55, solver
