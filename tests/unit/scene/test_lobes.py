"""Mean radiance of the lobes per cell, and its written-out derivatives."""

import drjit as dr
import numpy as np
import pytest

from unlit.machine.runtime import mitsuba
from unlit.scene.cells import grid_cells
from unlit.scene.light import SphericalGaussians
from unlit.scene.lobes import CellRadiance

mi = mitsuba()

CELLS = grid_cells(12, 24)


def lobes(count: int = 40, low: float = 5.0, high: float = 60.0) -> SphericalGaussians:
    rng = np.random.default_rng(8)
    axis = rng.standard_normal((count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return SphericalGaussians(
        axis.astype(np.float32),
        np.geomspace(low, high, count).astype(np.float32),
        rng.uniform(0.2, 1.5, count).astype(np.float32),
    )


def test_mean_per_cell() -> None:
    """Equal to the mean of a fine raster over each cell, and float32 of the cells' number."""
    light = lobes()
    ours = CellRadiance(CELLS).of(light)
    assert ours.shape == (288,)
    assert ours.dtype == np.float32
    truth = CELLS.average(light.rasterize(480, 960))
    assert np.abs(ours - truth).max() < 5e-3 * truth.max()
    assert ours.mean() == pytest.approx(truth.mean(), rel=1e-3)


def test_a_lobe_as_narrow_as_its_cell_keeps_its_flux() -> None:
    """Wherever a narrow lobe points, between nodes or on them, its power arrives."""
    rng = np.random.default_rng(2)
    cells = CellRadiance(grid_cells())
    for _ in range(20):
        axis = rng.standard_normal((1, 3))
        axis /= np.linalg.norm(axis)
        light = SphericalGaussians(
            axis.astype(np.float32), np.array([60.0], "f4"), np.array([1.0], "f4")
        )
        flux = (cells.of(light) * grid_cells().solid_angle).sum()
        assert flux == pytest.approx(2 * np.pi / 60 * (1 - np.exp(-120)), rel=0.01)


@pytest.mark.parametrize("parameter", ["axis", "sharpness", "amplitude"])
def test_gradient(parameter: str) -> None:
    """Within 1 % of central differences of a weighted sum, along random directions."""
    light = lobes()
    cells = CellRadiance(CELLS)
    rng = np.random.default_rng(5)
    weight = mi.Float(rng.standard_normal(len(CELLS)).astype(np.float32))

    def loss(values: dict[str, np.ndarray]) -> float:
        scene = SphericalGaussians(**values)
        out = cells.of(scene).astype(np.float64)
        return float((out * weight.numpy().astype(np.float64)).sum())

    at = {"axis": light.axis, "sharpness": light.sharpness, "amplitude": light.amplitude}
    arrays = {
        "axis": mi.Vector3f(np.ascontiguousarray(light.axis.T)),
        "sharpness": mi.Float(light.sharpness),
        "amplitude": mi.Float(light.amplitude),
    }
    dr.enable_grad(arrays[parameter])
    dr.backward(dr.sum(weight * cells(**arrays)))
    gradient = dr.grad(arrays[parameter]).numpy().T.astype(np.float64)
    step = {"axis": 2e-3, "sharpness": 5e-2, "amplitude": 1e-2}[parameter]
    for _ in range(3):
        direction = rng.standard_normal(at[parameter].shape)
        if parameter == "axis":
            # Off the sphere the formula differs from a lobe's; move along it.
            direction -= (direction * light.axis).sum(axis=1, keepdims=True) * light.axis
        ends = [
            loss({**at, parameter: (at[parameter] + s * direction).astype(np.float32)})
            for s in (step, -step)
        ]
        numeric = (ends[0] - ends[1]) / (2 * step)
        assert (gradient * direction).sum() == pytest.approx(numeric, rel=0.01)
