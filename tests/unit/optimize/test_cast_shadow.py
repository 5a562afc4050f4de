"""What counts as a shadow of something else, and what stays skin."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from unlit.optimize.cast_shadow import shadowed
from unlit.optimize.first_look import FirstLook

SIZE = 256
Y, X = np.mgrid[0:SIZE, 0:SIZE]
FACE = ((X - 128) / 80) ** 2 + ((Y - 128) / 105) ** 2 < 1
BROWS = FACE & (abs(Y - 95) < 5) & (abs(abs(X - 128) - 35) < 22)
ABOVE = Y < 150  # the base of the nose
RNG = np.random.default_rng(0)


def found(dark: np.ndarray, factor: float = 0.4, light: float = 0.8) -> np.ndarray:
    """What is taken for a shadow on a face that is plain but for `dark`; noisy."""
    regions = np.zeros((SIZE, SIZE, 4), np.float32)
    regions[..., 3] = BROWS
    regions[..., 0] = FACE & ~BROWS
    render = np.full((SIZE, SIZE, 3), 0.3, np.float32) * FACE[..., None]
    image = render * np.where(dark, factor, 1)[..., None] * np.where(BROWS, 0.3, 1)[..., None]
    image = image * (1 + 0.05 * RNG.standard_normal(image.shape))
    look = FirstLook(np.full((SIZE, SIZE), light), np.zeros((SIZE, SIZE)), render, FACE)
    return shadowed(SimpleNamespace(image=image, regions=regions), look, ABOVE)  # type: ignore[arg-type]


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
