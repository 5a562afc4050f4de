"""The light: lobes, their raster, the standard lights, and the environment map's convention."""

from typing import Any

import drjit as dr
import numpy as np
import pytest

from unlit.machine.runtime import mitsuba
from unlit.render.reference import mitsuba_environment
from unlit.scene.light import (
    GRID,
    RASTER,
    SphericalGaussians,
    coloured,
    disc,
    flash,
    grid_lobes,
    latlong_directions,
    latlong_solid_angles,
    uniform,
)

mi = mitsuba()


def irradiance(environment: np.ndarray, normal: tuple[float, float, float]) -> float:
    """E / pi of an unoccluded surface, by quadrature over the map's pixels."""
    size = environment.shape[:2]
    n = np.array(normal) / np.linalg.norm(normal)
    cosine = np.maximum(latlong_directions(*size) @ n, 0)
    return float((environment * cosine * latlong_solid_angles(*size)).sum() / np.pi)


def test_a_grey_map_gets_three_equal_channels():
    """One that has colours stays as it is."""
    grey = uniform(2.0)
    assert coloured(grey).shape == (*RASTER, 3) and (coloured(grey) == 2).all()
    rgb = np.random.default_rng(1).random((4, 8, 3))
    assert coloured(rgb) is rgb


def test_solid_angles_fill_the_sphere() -> None:
    """The pixels' solid angles sum to 4 pi and follow the sine of the polar angle."""
    omega = latlong_solid_angles(*RASTER)
    assert omega.shape == RASTER
    assert omega.sum() == pytest.approx(4 * np.pi)
    sines = np.sin(np.radians([90.5, 30.5]))
    assert omega[90, 0] / omega[30, 0] == pytest.approx(sines[0] / sines[1], rel=1e-3)


def test_directions_follow_the_convention() -> None:
    """The map's centre is +z, frontal light; its top is +y; a quarter from the left is +x."""
    d = latlong_directions(180, 360)
    assert np.linalg.norm(d, axis=-1) == pytest.approx(1.0)
    assert d[90, 180] == pytest.approx([0, 0, 1], abs=0.02)
    assert d[0, 17] == pytest.approx([0, 1, 0], abs=0.02)
    assert d[90, 90] == pytest.approx([1, 0, 0], abs=0.02)
    assert d[90, 0] == pytest.approx([0, 0, -1], abs=0.02)


def test_power_of_lobes_is_the_rasters_flux() -> None:
    """Closed-form power against the raster's flux, for broad and narrow lobes."""
    rng = np.random.default_rng(1)
    axis = rng.standard_normal((12, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    sharpness = np.geomspace(0.1, 300, 12)
    light = SphericalGaussians(
        axis.astype(np.float32),
        sharpness.astype(np.float32),
        rng.uniform(0.5, 2, 12).astype(np.float32),
    )
    raster = light.rasterize()
    assert raster.shape == RASTER
    assert raster.dtype == np.float32
    flux = (raster * latlong_solid_angles(*RASTER)).sum()
    of_lobes = 2 * np.pi * light.amplitude / sharpness * (1 - np.exp(-2 * sharpness))
    assert flux == pytest.approx(of_lobes.sum(), rel=2e-3)
    assert light.scaled(3.0).rasterize() == pytest.approx(3 * raster, rel=1e-5)


def test_grid_lobes_are_nearly_uniform() -> None:
    """The start of the optimisation: 648 lobes that add up to the radiance asked for."""
    light = grid_lobes(46.0, 1.5)
    assert len(light.axis) == GRID[0] * GRID[1] == 648
    raster = light.rasterize()
    mean = (raster * latlong_solid_angles(*RASTER)).sum() / (4 * np.pi)
    assert mean == pytest.approx(1.5, rel=0.01)
    assert np.abs(raster / 1.5 - 1).max() < 0.15


def test_uniform() -> None:
    """A constant light of radiance L gives E / pi = L on any unoccluded surface."""
    assert irradiance(uniform(0.7), (0.2, -0.5, 0.8)) == pytest.approx(0.7, rel=1e-3)


def test_flash_renders_a_white_card_as_its_irradiance() -> None:
    """E / pi as promised towards the light, its cosine elsewhere, no light from behind."""
    environment = flash(1.3)
    assert environment.shape == RASTER
    assert irradiance(environment, (0, 0, 1)) == pytest.approx(1.3, rel=1e-3)
    assert irradiance(environment, (0, 0.6, 0.8)) == pytest.approx(1.3 * 0.8, rel=3e-3)
    assert irradiance(environment, (0, 0, -1)) == 0


@pytest.mark.parametrize("direction", [(0.87, 0.1, 0.5), (-0.2, 0.97, 0.1), (0.0, 0.0, -3.0)])
def test_disc(direction: tuple[float, float, float]) -> None:
    """Irradiance as promised wherever the disc is, and no light outside its edge."""
    environment = disc(direction, 0.8, half_angle=5.0)
    assert irradiance(environment, direction) == pytest.approx(0.8, rel=1e-3)
    axis = np.array(direction) / np.linalg.norm(direction)
    angle = np.degrees(np.arccos(np.clip(latlong_directions(*RASTER) @ axis, -1, 1)))
    assert (environment[angle > 5.8] == 0).all()
    assert (environment[angle < 4.2] > 0).all()


def test_mitsuba_puts_a_bright_pixel_in_the_same_direction() -> None:
    """Rays of Mitsuba's envmap find one bright pixel where the convention says, with its flux."""
    small = np.full((18, 36), 0.1, dtype=np.float32)
    small[5, 22] = 20.0
    scene = mi.load_dict(
        {"type": "scene", "light": {"type": "envmap", "bitmap": mitsuba_environment(small)}}
    )
    size = (360, 720)
    directions = latlong_directions(*size)
    si = _looking(directions)
    seen = scene.environment().eval(si).numpy()[0].reshape(size)
    peak = np.unravel_index(np.argmax(seen), size)
    assert np.dot(directions[peak], latlong_directions(18, 36)[5, 22]) > np.cos(np.radians(5.1))
    omega = latlong_solid_angles(*size)
    centroid = (directions * ((seen - 0.1) * omega)[..., None]).sum(axis=(0, 1))
    expected = (latlong_directions(18, 36) * (small - 0.1)[..., None]).sum(axis=(0, 1))
    cosine = centroid @ expected / np.linalg.norm(centroid) / np.linalg.norm(expected)
    assert np.degrees(np.arccos(min(cosine, 1))) < 0.3
    flux = (small * latlong_solid_angles(18, 36)).sum()
    assert (seen * omega).sum() == pytest.approx(flux, rel=3e-3)


@pytest.mark.parametrize("name", ["uniform", "flash", "side"])
def test_mitsuba_sees_the_same_irradiance(name: str) -> None:
    """The Mitsuba map has the flux and irradiance of ours: an unnoticed bias would be shading."""
    ours = {"uniform": uniform(), "flash": flash(), "side": disc((0.87, 0.1, 0.5))}[name]
    scene = mi.load_dict(
        {"type": "scene", "light": {"type": "envmap", "bitmap": mitsuba_environment(ours)}}
    )
    size = (4 * 180, 4 * 360)
    seen = scene.environment().eval(_looking(latlong_directions(*size))).numpy()[0].reshape(size)
    n = (0.4, 0.1, 0.9)
    assert irradiance(seen, n) == pytest.approx(irradiance(ours, n), rel=2e-3)


def _looking(directions: np.ndarray) -> Any:
    """Interactions at infinity of rays that leave along `directions` (H, W, 3)."""
    flat = np.ascontiguousarray(directions.reshape(-1, 3).T, dtype=np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, flat.shape[1])
    si.wi = -mi.Vector3f(flat)
    return si
