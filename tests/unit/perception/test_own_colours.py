"""Skin and hair by their own colours, on two materials of which every pixel is known."""

from __future__ import annotations

import numpy as np
import pytest

from unlit.perception.own_colours import by_own_colours

SKIN, HAIR = np.array([0.5, 0.3, 0.22]), np.array([0.06, 0.04, 0.03])
COLUMNS = np.broadcast_to(np.arange(200), (60, 200))


def seen(border: int, light: np.ndarray | float = 1.0, hair: np.ndarray = HAIR) -> np.ndarray:
    """Skin left of a column, hair right of it, with 5 % of noise."""
    image = np.where((border > COLUMNS)[..., None], SKIN, hair)
    noise = np.random.default_rng(0).normal(1, 0.05, image.shape)
    return (image * noise * light).astype(np.float32)


def told(image: np.ndarray, first: int = 60, last: int = 140) -> np.ndarray:
    """The parser is sure before the first column and after the last, and says a half between."""
    skin = np.where(first > COLUMNS, 0.95, np.where(last <= COLUMNS, 0.05, 0.5))
    return by_own_colours(image, skin, 1 - skin)


def test_colours_decide_where_the_parser_does_not() -> None:
    """The border is found to the pixel, wherever it lies between."""
    for border in (80, 101, 133):
        share = told(seen(border))
        assert share.shape == COLUMNS.shape and share.dtype == np.float32
        np.testing.assert_array_equal(share > 0.5, border > COLUMNS)


def test_a_soft_shadow_stays_skin() -> None:
    """Half of the light on part of the skin in doubt: chromaticity tells it from hair."""
    light = np.where((COLUMNS > 85) & (COLUMNS < 101), 0.5, 1.0)[..., None]
    assert (told(seen(101, light))[:, 60:101] > 0.5).all()


def test_alike_colours_change_nothing() -> None:
    """Hair of the skin's own colour: the parser's word stands."""
    assert told(seen(100, hair=SKIN))[:, 60:140].mean() == pytest.approx(0.5, abs=0.03)


def test_without_samples_the_parser_stands() -> None:
    """A bald head, or too few pixels of hair."""
    image, skin = seen(200), np.full(COLUMNS.shape, 0.7)
    np.testing.assert_allclose(
        by_own_colours(image, skin, 0.3 * np.ones_like(skin)), 0.7, rtol=1e-5
    )
    bald = by_own_colours(image, np.ones_like(skin), np.zeros_like(skin))
    np.testing.assert_array_equal(bald, 1)
