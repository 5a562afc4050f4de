"""Lights by name, their strength, and turning them."""

from pathlib import Path

import numpy as np
import pytest

from unlit.errors import PictureError, SettingsError
from unlit.output.images import exr
from unlit.relighting.lights import LIGHTS, environment_map, sun, turned, with_unit_irradiance
from unlit.scene.light import latlong_directions, latlong_solid_angles, uniform


def weights(environment: np.ndarray) -> np.ndarray:
    """Flux of each pixel, (H, W)."""
    return environment * latlong_solid_angles(*environment.shape)


def centre(environment: np.ndarray) -> np.ndarray:
    """Unit mean direction (3,) of the light."""
    mean = np.einsum("ij,ijx->x", weights(environment), latlong_directions(*environment.shape))
    return mean / np.linalg.norm(mean)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "direction"),
    [
        (0, 0, (0, 0, 1)),  # from the camera, which is where +z points
        (90, 0, (1, 0, 0)),  # from the picture's right
        (-90, 0, (-1, 0, 0)),
        (180, 0, (0, 0, -1)),  # from behind the head
        (17, 90, (0, 1, 0)),
        (-30, 45, (-(0.5**1.5), 0.5**0.5, 0.5 * 1.5**0.5)),
    ],
)
def test_sun(azimuth: float, elevation: float, direction: tuple[float, ...]) -> None:
    """Where it stands, how large it is, and how bright a card that faces it becomes."""
    light = sun(azimuth, elevation)
    assert centre(light) == pytest.approx(direction, abs=2e-3)
    away = latlong_directions(*light.shape)[light > 0] @ np.array(direction)
    assert np.degrees(np.arccos(away.min())) < 1.0
    cosine = np.maximum(latlong_directions(*light.shape) @ np.array(direction), 0)
    assert (weights(light) * cosine).sum() / np.pi == pytest.approx(1, rel=1e-3)


def test_named(tmp_path: Path) -> None:
    """Names, a sun, and a file, whose negative values are cut."""
    for name, make in LIGHTS.items():
        np.testing.assert_array_equal(environment_map(name), make())
    np.testing.assert_array_equal(environment_map("sun:-60,30.5"), sun(-60, 30.5))
    sky = np.random.default_rng(0).uniform(-0.1, 40, (8, 16, 3)).astype(np.float32)
    (tmp_path / "sky.exr").write_bytes(exr(sky))
    np.testing.assert_array_equal(environment_map(str(tmp_path / "sky.exr")), np.maximum(sky, 0))


@pytest.mark.parametrize(
    "name", ["moon", "sky.png", "sun:", "sun:1", "sun:a,b", "sun:0,91", "sun:nan,0", "sun:1,2,3"]
)
def test_unknown_names(name: str) -> None:
    """One line that says what can be given."""
    with pytest.raises(SettingsError, match=r"give .*sun:AZIMUTH,ELEVATION") as caught:
        environment_map(name)
    assert "\n" not in str(caught.value)


def test_turned() -> None:
    """Azimuth grows; flux is kept between pixels, too; a whole turn and a uniform light stay."""
    front = sun(0, 20)
    for degrees in (37.0, -90.25, 123.4):
        light = turned(front, degrees)
        assert centre(light) == pytest.approx(centre(sun(degrees, 20)), abs=2e-3)
        assert weights(light).sum() == pytest.approx(weights(front).sum(), rel=1e-5)
    noise = np.random.default_rng(1).random((6, 12, 3)).astype(np.float32)
    np.testing.assert_array_equal(turned(noise, 360), noise)
    np.testing.assert_array_equal(turned(noise, 30)[:, 5], noise[:, 6])
    np.testing.assert_array_equal(turned(uniform(), 12.3), uniform())


def test_exposed() -> None:
    """The units of a file do not matter, nor does how the light is turned; colour is kept."""
    rng = np.random.default_rng(2)
    sky = (rng.random((40, 80, 3)) ** 8 * (1.0, 0.7, 0.4)).astype(np.float32)
    light = with_unit_irradiance(sky, "sky.hdr")
    assert with_unit_irradiance(1000 * sky, "sky.hdr") == pytest.approx(light, rel=1e-4)
    assert with_unit_irradiance(turned(sky, 90), "sky.hdr") == pytest.approx(
        turned(light, 90), rel=1e-4
    )
    assert light / light.max() == pytest.approx(sky / sky.max(), rel=1e-4)
    # The brightest upright card, by a plain sum over the pixels.
    directions, flux = latlong_directions(40, 80), weights(light.mean(axis=2))
    cards = [(np.sin(a), 0, np.cos(a)) for a in np.arange(0, 2 * np.pi, 0.02)]
    brightest = max((flux * np.maximum(directions @ np.array(n), 0)).sum() for n in cards) / np.pi
    assert brightest == pytest.approx(1, rel=0.01)
    assert with_unit_irradiance(5 * uniform(), "grey.exr") == pytest.approx(uniform(), rel=2e-3)
    assert with_unit_irradiance(np.ones((700, 1400), np.float32), "fine.hdr").shape == (512, 1024)
    with pytest.raises(PictureError, match=r"night\.hdr: black"):
        with_unit_irradiance(np.zeros((4, 8, 3), np.float32), "night.hdr")
