"""What the settings say of the photo's light, or ask to be found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from unlit.conditions import estimate as module
from unlit.conditions.estimate import estimate_conditions
from unlit.errors import SettingsError
from unlit.face.conditions import Conditions, LightEstimate, Shadow
from unlit.face.photo import FacePhoto
from unlit.photo.photo import Photo


def estimated(seen: FacePhoto, **chosen: object) -> Conditions:
    """With something white elsewhere in the photo."""
    settings = tiny_run.settings(**chosen)
    source = Photo.of(np.ones((60, 90, 3), np.float32))
    return estimate_conditions(seen, tiny_run.head(), source, settings)


def test_above_is_towards_the_hairline(monkeypatch: pytest.MonkeyPatch) -> None:
    """However the head is rolled; and `keep` does not look at all."""
    seen = tiny_run.photo()
    size = len(seen.image)
    landmarks = np.zeros((478, 3))
    landmarks[[10, 152, 2], 0] = 0.1 * size, 0.9 * size, 0.6 * size  # lying on one side
    landmarks[:, 1] = size / 2
    asked: list[np.ndarray] = []
    monkeypatch.setattr(module, "cast_shadow", lambda _, above, __: asked.append(above))
    seen = replace(seen, landmarks=landmarks)
    assert estimated(seen, **{"cast_shadow.mode": "auto"}).shadow is None
    columns = np.indices((size, size))[1] + 0.5
    np.testing.assert_array_equal(asked[0], columns < 0.6 * size)
    estimated(seen, **{"cast_shadow.mode": "keep"})
    assert len(asked) == 1


def test_shadows_are_looked_for_as_under_white_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is found of them is kept."""
    seen = tiny_run.photo()
    asked: list[np.ndarray] = []
    shadow = Shadow(seen.image[..., 0], seen.image, seen.image[..., 0])

    def found(observation: object, *_: object) -> Shadow:
        asked.append(observation.image)  # type: ignore[attr-defined]
        return shadow

    monkeypatch.setattr(module, "cast_shadow", found)
    monkeypatch.setattr(module, "above", lambda *_: None)
    lamp = np.array([1, 0.5, 0.25], np.float32)
    coloured = replace(seen, image=seen.image * lamp)
    conditions = estimated(coloured, light_color="4,2,1", **{"cast_shadow.mode": "auto"})
    np.testing.assert_array_equal(conditions.light_color, lamp)
    np.testing.assert_array_equal(asked[0], seen.image)
    assert conditions.shadow is shadow


def test_an_image_as_if_white_stays_the_image_itself() -> None:
    """Not even a copy: a result under white light cannot differ from one without the option."""
    seen = tiny_run.photo()
    conditions = estimated(seen)
    assert conditions.light_estimate is None
    assert conditions.balanced(seen.image) is seen.image


def test_a_light_to_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The colour comes with what its estimate says of itself."""
    lamp, about = np.array([1, 0.75, 0.5], np.float32), LightEstimate(used=True, kelvin=4000)
    monkeypatch.setattr(module, "estimated_color", lambda *_: (lamp, about))
    conditions = estimated(tiny_run.photo(), light_color="auto")
    np.testing.assert_array_equal(conditions.light_color, lamp)
    assert conditions.light_estimate is about


def test_a_dim_photo_is_seen_as_bright_as_others() -> None:
    """What white has in it is part of the light's colour; the face becomes what it would be."""
    seen, settings = tiny_run.photo(), tiny_run.settings()
    pixels = np.zeros((60, 90, 3), np.float32)
    pixels[:30] = 0.75
    bright, dim = (
        estimate_conditions(replace(seen, image=seen.image * k), tiny_run.head(), source, settings)
        for k, source in ((1.0, Photo.of(pixels)), (0.125, Photo.of(0.125 * pixels)))
    )
    np.testing.assert_array_equal(bright.light_color, np.ones(3))
    white = 0.125 * 0.75 / 0.7
    np.testing.assert_allclose(dim.light_color, white, rtol=1e-6)
    balanced = dim.balanced(0.125 * seen.image)
    np.testing.assert_allclose(balanced, seen.image * 0.7 / 0.75, rtol=1e-5)


def test_a_grey_card_is_read_in_the_photo() -> None:
    """In its own pixels, not the crop's; one outside cannot be read."""
    seen = tiny_run.photo()
    pixels = np.full((60, 90, 3), 0.02, np.float32)
    pixels[40:, 70:] = (0.4, 0.2, 0.1)
    source, head = Photo.of(pixels), tiny_run.head()
    settings = tiny_run.settings(light_color="80,50")
    found = estimate_conditions(seen, head, source, settings)
    color = found.light_color / found.light_color[0]
    np.testing.assert_allclose(color, (1, 0.5, 0.25), rtol=1e-5)
    with pytest.raises(SettingsError, match="800,50: outside the photo"):
        estimate_conditions(seen, head, source, tiny_run.settings(light_color="800,50"))
