"""What counts as a shadow of something else, and what stays skin."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from unlit.conditions import cast_shadow as module
from unlit.conditions.cast_shadow import cast_shadow, remaining, shadowed
from unlit.conditions.first_stage import ShortStage1
from unlit.optimize.observation import Observation
from unlit.scene.camera import Camera
from unlit.scene.surface_points import SurfacePoints
from unlit.settings.conditions import CastShadow
from unlit.settings.settings import PRESETS

SIZE = 256
Y, X = np.mgrid[0:SIZE, 0:SIZE]
FACE = ((X - 128) / 80) ** 2 + ((Y - 128) / 105) ** 2 < 1
BROWS = FACE & (abs(Y - 95) < 5) & (abs(abs(X - 128) - 35) < 22)
ABOVE = Y < 150  # the base of the nose
RNG = np.random.default_rng(0)


def found(dark: np.ndarray, factor: float | np.ndarray = 0.4, light: float = 0.8) -> np.ndarray:
    """What is taken for a shadow on a face that is plain but for `dark`; noisy."""
    regions = np.zeros((SIZE, SIZE, 5), np.float32)
    regions[..., 3] = BROWS
    regions[..., 0] = FACE & ~BROWS
    render = np.full((SIZE, SIZE, 3), 0.3, np.float32) * FACE[..., None]
    image = render * np.where(dark, factor, 1)[..., None] * np.where(BROWS, 0.3, 1)[..., None]
    image = image * (1 + 0.05 * RNG.standard_normal(image.shape))
    stage1 = ShortStage1(np.full((SIZE, SIZE), light), np.zeros((SIZE, SIZE)), render, FACE)
    return shadowed(_seen(image, regions), stage1, ABOVE, CastShadow())  # type: ignore[arg-type]


def _seen(image: np.ndarray, regions: np.ndarray) -> SimpleNamespace:
    """Of an observation, what is asked for."""
    return SimpleNamespace(image=image, regions=regions, fitted=np.ones_like(FACE))


def agreement(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


@pytest.mark.parametrize(
    "dark",
    [FACE & (80 + 4 * np.sin(X / 9) > Y), FACE & (165 + 3 * np.sin(Y / 11) < X)],
    ids=["hat", "hair"],
)
def test_a_shadow_from_the_outline_is_found(dark: np.ndarray) -> None:
    """On skin, also beside the brow that the shadow of hair crosses; the brow stays."""
    shadow = found(dark)
    assert agreement(shadow, dark & ~BROWS) > 0.9
    assert not shadow[BROWS].any()


@pytest.mark.parametrize(
    "dark",
    [
        np.zeros_like(FACE),
        FACE & (Y > 170),
        (X - 95) ** 2 + (Y - 130) ** 2 < 20**2,
        FACE & (abs(X - 128) > 76),
        FACE & (Y < 160),
    ],
    ids=["nothing", "beard", "birthmark", "thin rim", "most of the face"],
)
def test_other_dark_skin_stays(dark: np.ndarray) -> None:
    assert not found(dark).any()


def test_a_shadow_is_much_darker_than_the_model_and_not_where_the_model_is_dark() -> None:
    hat = FACE & (Y < 80)
    assert not found(hat, factor=0.75).any()
    assert not found(hat, light=0.1).any()


def test_what_darkens_gradually_is_no_shadow() -> None:
    """A forehead that falls off to the hair, by as much as a shadow would, over 50 pixels."""
    gradual = np.clip(0.3 + (Y - 30) / 70, 0.3, 1)
    assert not found(FACE, factor=gradual).any()
    hard = found(FACE & (Y < 60), factor=0.3)
    assert agreement(hard, FACE & (Y < 60)) > 0.9


def test_ears_and_neck_are_not_looked_at() -> None:
    """Dark skin where no landmark holds the head, as a neck below the chin is."""
    dark = FACE & (Y < 80)
    seen = _seen(np.where(dark, 0.1, 0.3)[..., None] * np.ones(3), np.zeros((SIZE, SIZE, 4)))
    render = np.full((SIZE, SIZE, 3), 0.3) * FACE[..., None]
    stage1 = ShortStage1(np.ones((SIZE, SIZE)), np.zeros((SIZE, SIZE)), render, FACE)
    assert shadowed(seen, stage1, ABOVE, CastShadow()).any()  # type: ignore[arg-type]
    seen.fitted = Y >= 80
    assert not shadowed(seen, stage1, ABOVE, CastShadow()).any()  # type: ignore[arg-type]


def test_skin_that_the_photo_clips_is_no_shadow() -> None:
    """The model may be far above white there."""
    render = np.where(FACE & (Y < 80), 2.2, 0.8)[..., None] * np.ones(3)
    regions = np.dstack([FACE, 0 * Y, 0 * Y, 0 * Y]).astype(np.float32)
    stage1 = ShortStage1(
        np.ones_like(render[..., 0]), 0 * render[..., 0], render * FACE[..., None], FACE
    )
    photo = _seen(np.minimum(stage1.render, 1), regions)
    assert not shadowed(photo, stage1, ABOVE, CastShadow()).any()  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", [1, 2])
def test_it_is_found_at_any_size(monkeypatch, scale: int) -> None:
    """The photo at 512 is looked at in 256 pixels; the answer has its own size, in its place."""
    render = np.full((SIZE, SIZE, 3), 0.3, np.float32) * FACE[..., None]
    seen: list[Observation] = []

    def stage1(observation: Observation, settings: object) -> ShortStage1:
        seen.append(observation)
        return ShortStage1(np.full((SIZE, SIZE), 0.8), np.zeros((SIZE, SIZE)), render, FACE)

    def large(image: np.ndarray) -> np.ndarray:
        return cv2.resize(image.astype(np.float32), None, fx=scale, fy=scale)

    monkeypatch.setattr(module, "short_stage1", stage1)
    hat = FACE & (Y < 80)
    face = large(FACE)
    regions = np.dstack([face, 0 * face, 0 * face, 0 * face])
    image = large(render * np.where(hat, 0.4, 1)[..., None])
    size = scale * SIZE
    camera = Camera(size, size, 3.0 * size, 0.4 * size, 0.6 * size)
    points = np.array([[0.2, 0.3]]) * size
    none = SurfacePoints.empty(1)
    mask = face > 0.5
    observed = Observation(image, regions, mask, face, mask, camera, points, points, points, none)
    shadow = cast_shadow(observed, large(ABOVE) > 0.5, PRESETS["draft"])
    assert shadow is not None and shadow.sun is None
    assert shadow.visibility.shape == (size, size) and shadow.remaining.shape == (size, size, 3)
    assert agreement(shadow.visibility < 0.5, large(hat) > 0.5) > 0.9
    small = seen[0]
    assert vars(small.camera) == vars(Camera(SIZE, SIZE, 3.0 * SIZE, 0.4 * SIZE, 0.6 * SIZE))
    np.testing.assert_allclose(small.landmarks, np.array([[0.2, 0.3]]) * SIZE)
    assert not seen[1].weight[hat & (Y < 75)].any()


def test_what_remains_is_the_light_and_not_the_skin() -> None:
    """Its level and colour, not fine details, nor brows, which are dark; elsewhere all of it."""
    render = np.full((SIZE, SIZE, 3), 0.3) * FACE[..., None]
    dark = FACE & (Y < 110)
    left = np.array([0.5, 0.4, 0.3])
    image = render * np.where(dark[..., None], left, 1.5) * np.where(BROWS, 0.2, 1)[..., None]
    image = image * (1 + 0.2 * (-1.0) ** (X + Y))[..., None]
    regions = np.dstack([FACE & ~BROWS, 0 * X, 0 * X, BROWS]).astype(np.float32)
    stage1 = ShortStage1(np.ones((SIZE, SIZE)), np.zeros((SIZE, SIZE)), render, FACE)
    found = remaining(_seen(image, regions), stage1, dark, CastShadow())  # type: ignore[arg-type]
    core = dark & (Y > 45) & (Y < 98) & (abs(X - 128) < 30)
    assert (core & BROWS).any()
    np.testing.assert_allclose(found[core], np.broadcast_to(left, found[core].shape), rtol=0.06)
    np.testing.assert_allclose(found[FACE & (Y > 130)], 1, atol=1e-3)
    assert found.max() <= 1
