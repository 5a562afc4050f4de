"""The quadrature of the sphere."""

import numpy as np
import pytest

from unlit.scene.cells import SphereCells, even_cells, grid_cells, refine
from unlit.scene.light import disc, flash, latlong_directions, latlong_solid_angles, uniform


def quarters_of(seed: int) -> SphereCells:
    """Irregular cells: a coarse grid with random cells split twice."""
    rng = np.random.default_rng(seed)
    cells = grid_cells(6, 10)
    for _ in range(2):
        cells = cells.split(rng.random(len(cells)) < 0.4)
    return cells


@pytest.mark.parametrize("cells", [grid_cells(), even_cells(), quarters_of(0)])
def test_cells_tile_the_sphere(cells: SphereCells) -> None:
    """Solid angles sum to 4 pi, first moments to zero, also after splitting."""
    assert cells.solid_angle.sum() == pytest.approx(4 * np.pi)
    assert cells.moment.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.linalg.norm(cells.direction, axis=1) == pytest.approx(1.0)


def test_even_cells_are_alike() -> None:
    """From pole to pole within a quarter of the mean solid angle; the grid's shrink to a tenth."""
    mean = 4 * np.pi / len(even_cells())
    assert even_cells().solid_angle == pytest.approx(mean, rel=0.26)
    assert grid_cells().solid_angle.min() < 0.15 * grid_cells().solid_angle.mean()


def test_moment_and_direction_against_fine_sums() -> None:
    """The closed forms equal sums over a fine map; the direction lies inside its cell."""
    cells = grid_cells(6, 12)
    fine = latlong_directions(600, 1200) * latlong_solid_angles(600, 1200)[..., None]
    sums = fine.reshape(6, 100, 12, 100, 3).sum(axis=(1, 3)).reshape(-1, 3)
    assert cells.moment == pytest.approx(sums, abs=2e-5)
    theta = np.arccos(cells.direction[:, 1])
    assert ((theta > cells.theta[:, 0]) & (theta < cells.theta[:, 1])).all()
    # A cosine integral over the sphere: n . m summed over the hemisphere is pi.
    up = np.maximum(cells.moment[:, 1], 0).sum()
    assert up == pytest.approx(np.pi, rel=1e-6)


def test_average_of_constant_and_of_own_pixels() -> None:
    """Exact on a constant map, on the map whose pixels are the cells, and on coarser maps."""
    cells = quarters_of(2)
    assert cells.average(uniform(0.3)) == pytest.approx(0.3, rel=1e-5)
    rng = np.random.default_rng(3)
    own = rng.random((18, 36)).astype(np.float32)
    assert grid_cells().average(own) == pytest.approx(own.ravel(), rel=1e-5)
    assert grid_cells(36, 72).average(own) == pytest.approx(
        own.repeat(2, 0).repeat(2, 1).ravel(), rel=1e-4
    )


def test_average_keeps_the_flux_when_edges_cross_pixels() -> None:
    """Cells whose edges fall inside pixels share them out: flux is kept, in colour too."""
    rng = np.random.default_rng(4)
    environment = rng.random((50, 90, 3)).astype(np.float32) ** 4
    cells = quarters_of(5)
    mean = cells.average(environment)
    assert mean.shape == (len(cells), 3)
    flux = (environment * latlong_solid_angles(50, 90)[..., None]).sum(axis=(0, 1))
    assert (mean * cells.solid_angle[:, None]).sum(axis=0) == pytest.approx(flux, rel=1e-5)


@pytest.mark.parametrize("environment", [flash(), disc((0.87, 0.1, 0.5)), disc((0, 1, 0.01))])
def test_refine_keeps_flux_and_finds_small_lights(environment: np.ndarray) -> None:
    """No cell holds much of a small light, the lit cells fit its outline; flux and limit hold."""
    cells = refine(grid_cells(), environment)
    flux = (environment * latlong_solid_angles(180, 360)).sum()
    mean = cells.average(environment)
    assert (mean * cells.solid_angle).sum() == pytest.approx(flux, rel=1e-4)
    assert cells.solid_angle.sum() == pytest.approx(4 * np.pi)
    assert 648 < len(cells) <= 2500
    assert (mean * cells.solid_angle).max() < 0.025 * flux
    lit = mean > 0.01 * mean.max()
    outline = latlong_solid_angles(180, 360)[environment > 0].sum()
    assert cells.solid_angle[lit].sum() < 2 * outline
    assert len(refine(grid_cells(), environment, limit=800)) <= 800


def test_refine_leaves_a_uniform_light_alone() -> None:
    """Nothing to gain, nothing split; repeated refinement changes nothing either."""
    assert len(refine(grid_cells(), uniform())) == 648
    assert len(refine(even_cells(), uniform())) == len(even_cells())
    once = refine(grid_cells(), flash())
    assert len(refine(once, flash())) == len(once)
