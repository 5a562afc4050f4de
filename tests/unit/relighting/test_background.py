"""What stands behind a relit person."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from saved_head import Saved
from unlit.errors import SettingsError
from unlit.photo.photo import read_photo
from unlit.relighting.background import background, check_background, colour_of, filling, seen
from unlit.scene.light import disc, uniform


def test_colours() -> None:
    grey = colour_of("#808080")
    assert grey is not None
    np.testing.assert_allclose(grey, 0.2158605, rtol=1e-4)
    white = colour_of("white")
    assert white is not None
    np.testing.assert_allclose(white, 1)
    assert colour_of("sunset.jpg") is None
    with pytest.raises(SettingsError, match="moonrock: no such background"):
        check_background("moonrock")


def test_each_kind(saved: Saved, tmp_path: Path) -> None:
    photo, light = read_photo(saved.photo), uniform(0.3)
    file = tmp_path / "wall.png"
    Image.fromarray(np.full((100, 100, 3), 255, np.uint8)).save(file)
    assert background("photo", saved.face, photo, light)(0) is None
    for text, value in (("#808080", 0.2158605), ("light", 0.3), (str(file), 1.0)):
        found = background(text, saved.face, photo, light)(30.0)
        assert found is not None
        assert found.shape == photo.pixels.shape
        np.testing.assert_allclose(found, value, rtol=1e-3)


def test_a_picture_fills_the_frame() -> None:
    """Its middle, in its own proportions."""
    picture = np.zeros((40, 100, 3), np.float32)
    picture[:, 30:70] = 1
    found = filling(picture, 60, 60)
    assert found.shape == (60, 60, 3)
    assert (found == 1).all()


def test_narrow_pictures_fill_it_too() -> None:
    for shape in ((64, 1, 3), (1, 64, 3)):
        picture = np.full(shape, 0.25, np.float32)
        for size in ((500, 1001), (1001, 500)):
            found = filling(picture, *size)
            assert found.shape == (*size[::-1], 3)
            np.testing.assert_allclose(found, 0.25)


@pytest.mark.parametrize("text", ["#80808000", "#808f"])
def test_a_colour_with_an_alpha_is_refused(text: str) -> None:
    with pytest.raises(SettingsError, match=f"{text}: a colour with an alpha"):
        check_background(text)


def test_the_light_behind_the_head_is_seen() -> None:
    """What the camera looks at is light from behind the head, its left on the left."""
    rays = np.stack(np.meshgrid(np.linspace(-1, 1, 41), np.linspace(1, -1, 41)), axis=-1)
    rays = np.concatenate([rays, -np.ones((41, 41, 1))], axis=-1)
    assert seen(disc((0, 0, 1)), rays).max() == 0
    light = seen(disc((-0.5, 0.2, -1.0), half_angle=6), rays)[..., 0]
    row, column = np.unravel_index(light.argmax(), light.shape)
    assert abs(row - 16) <= 3
    assert abs(column - 10) <= 3
