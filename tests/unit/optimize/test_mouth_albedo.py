"""In an open mouth the albedo is the photo over the light there, within what teeth have."""

from __future__ import annotations

import numpy as np

import tiny_run
from unlit.optimize.mouth_albedo import with_mouth
from unlit.optimize.problem import Problem
from unlit.perception.regions import REGIONS

SIZE = tiny_run.SIZE
TOOTH = np.array([0.8, 0.72, 0.6], np.float32)
LIP = np.array([0.5, 0.2, 0.2], np.float32)


def opened(light: float, share: float = 1.0) -> tuple[Problem, np.ndarray]:
    """What is found on teeth under an even light, where the stages have carried on the lips."""
    regions = np.zeros((SIZE, SIZE, len(REGIONS)), np.float32)
    regions[..., REGIONS.index("mouth")] = share
    regions[..., REGIONS.index("skin")] = 1 - share
    image = np.tile(TOOTH * light, (SIZE, SIZE, 1)).astype(np.float32)
    problem = tiny_run.problem(regions=regions, image=image)
    lips = np.tile(LIP, (len(problem), 1))
    return problem, with_mouth(problem, lips, 0 * lips, np.full_like(lips, light))


def test_the_teeth_are_those_of_the_photo() -> None:
    np.testing.assert_allclose(opened(0.5)[1], np.tile(TOOTH, (len(opened(0.5)[0]), 1)), rtol=0.02)


def test_the_dark_is_not_amplified_and_a_glare_stays_a_tooth() -> None:
    """Dimmer than what can be told: darker in proportion, of the photo's hue; never over white."""
    dim = opened(0.05)[1]
    np.testing.assert_allclose(dim / dim[:, :1], TOOTH[None] / TOOTH[0] + 0 * dim, rtol=0.02)
    assert dim.max() < 0.5 * TOOTH.max()
    problem, _ = opened(0.9)
    lips = np.tile(LIP, (len(problem), 1))
    bright = with_mouth(problem, lips, 0 * lips, np.full_like(lips, 0.3))
    assert bright.max() <= 1.2 + 1e-6
    np.testing.assert_allclose(bright / bright[:, :1], TOOTH[None] / TOOTH[0] + 0 * dim, rtol=0.02)


def test_a_closed_mouth_keeps_its_bits() -> None:
    problem, found = opened(0.5, share=0.0)
    np.testing.assert_array_equal(found, np.tile(LIP, (len(problem), 1)))


def test_a_lip_of_the_mesh_before_the_teeth_makes_no_bright_rim() -> None:
    """Half of the mouth is lit twice as well as the other: there the photo is met exactly."""
    problem, _ = opened(0.4)
    lips = np.tile(LIP, (len(problem), 1))
    light = np.where(problem.pixel % SIZE > SIZE // 2, 0.8, 0.4)[:, None] * np.ones((1, 3))
    found = with_mouth(problem, lips, 0 * lips, light.astype(np.float32))
    rendered = (found * light)[light[:, 0] > 0.5]
    np.testing.assert_allclose(rendered, np.broadcast_to(0.4 * TOOTH, rendered.shape), rtol=0.02)
