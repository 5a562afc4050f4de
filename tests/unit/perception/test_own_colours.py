"""The face's border by its own colours, on two materials of which every pixel is known."""

from __future__ import annotations

import numpy as np
import pytest

from unlit.perception.own_colours import _Colours, by_own_colours

SKIN, HAIR = np.array([0.5, 0.3, 0.22]), np.array([0.06, 0.04, 0.03])
COLUMNS = np.broadcast_to(np.arange(200), (60, 200))
ROWS = np.broadcast_to(np.arange(60)[:, None], (60, 200))
SIZE = 200.0


def seen(border: int, light: np.ndarray | float = 1.0, hair: np.ndarray = HAIR) -> np.ndarray:
    """Skin left of a column, hair right of it, with 5 % of noise."""
    image = np.where((border > COLUMNS)[..., None], SKIN, hair)
    noise = np.random.default_rng(0).normal(1, 0.05, image.shape)
    return (image * noise * light).astype(np.float32)


def told(image: np.ndarray, first: int = 60, last: int = 140) -> np.ndarray:
    """The parser is sure before the first column and after the last, and says a half between."""
    face = np.where(first > COLUMNS, 0.95, np.where(last <= COLUMNS, 0.05, 0.5))
    return by_own_colours(image, face, 1 - face, SIZE)


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


def test_what_is_near_counts_most() -> None:
    """The upper wall has the lower skin's colour, and the other way round."""
    upper = (ROWS < 30)[..., None]
    left = np.where(upper, SKIN, SKIN[::-1])
    right = np.where(upper, SKIN[::-1], SKIN)
    image = np.where((COLUMNS < 100)[..., None], left, right).astype(np.float32)
    far = np.abs(ROWS - 29.5) > 20  # of the other half's colours
    face = np.where(COLUMNS < 85, 0.95, np.where(COLUMNS >= 115, 0.05, 0.5))
    share = by_own_colours(image, face, np.zeros_like(face), 60.0)
    np.testing.assert_array_equal((share > 0.5)[far], (COLUMNS < 100)[far])


def test_hair_mixed_with_a_wall_is_no_skin() -> None:
    """Between brown hair and a pale wall pixels have a skin's colour, which is seen below."""
    wall = 2 * SKIN - HAIR
    part = np.clip((COLUMNS - 90) / 20, 0, 1)[..., None]
    image = np.where((ROWS >= 30)[..., None], SKIN, HAIR + part * (wall - HAIR))
    face = np.where(ROWS >= 35, 1.0, 0.14 * (np.abs(COLUMNS - 100) < 15))
    hair = (1 - face) * np.clip((COLUMNS - 85) / 30, 0, 1)[:, ::-1]
    share = by_own_colours(image.astype(np.float32), face, hair, SIZE)
    assert share[:25].max() < 0.4


def test_alike_colours_change_nothing() -> None:
    """Hair of the skin's own colour: the parser's word stands."""
    image = seen(100, hair=SKIN)
    assert told(image)[:, 60:140].mean() == pytest.approx(0.5, abs=0.03)
    face, hair = np.where(COLUMNS < 60, 1.0, 0.5), np.where(COLUMNS < 60, 0.0, 0.25)
    face[:, 140:], hair[:, 140:] = 0, ROWS[:, 140:] < 30  # what is left is a wall
    share = by_own_colours(image, face, hair, SIZE)
    assert share[:, 60:140].mean() == pytest.approx(0.5, abs=0.03)


def test_without_samples_the_parser_stands() -> None:
    """Nothing is sure, or all is face."""
    image = seen(200)
    for share in (0.7, 1.0):
        face = np.full(COLUMNS.shape, share)
        np.testing.assert_allclose(by_own_colours(image, face, 1 - face, SIZE), share, rtol=1e-6)


def test_flat_saturated_walls() -> None:
    """One colour over most of the picture: rounding must not leave it a negative variance."""
    rng = np.random.default_rng(3)
    face = np.zeros((512, 512), np.float32)
    face[200:330, 200:330] = 1
    face[195:335, 195:335] = np.maximum(face[195:335, 195:335], 0.5)
    for wall in rng.uniform(0, 1, (8, 3)):
        image = np.where(face[..., None] > 0.7, SKIN, wall).astype(np.float32)
        share = by_own_colours(image, face, np.zeros_like(face), 130.0)
        assert (share >= 0).all() and (share <= 1).all()


def test_densities_are_those_of_a_gaussian() -> None:
    """Up to a constant, correlations and each pixel's own width with them."""
    rng = np.random.default_rng(1)
    factors = rng.normal(0, 0.3, (2, 2, 3, 3))
    covariance = factors @ np.swapaxes(factors, -1, -2) + 0.02 * np.eye(3)
    mean, offset = rng.normal(0, 0.3, (2, 2, 3)), rng.normal(0, 0.3, (2, 2, 3))
    found = _Colours(mean, covariance).log_density((mean + offset).astype(np.float32))
    points = zip(offset.reshape(4, 3), covariance.reshape(4, 3, 3), strict=True)
    true = [-0.5 * (x @ np.linalg.solve(c, x) + np.linalg.slogdet(c)[1]) for x, c in points]
    np.testing.assert_allclose(found.ravel() - found[0, 0], np.array(true) - true[0], atol=1e-3)


def test_mixes_of_two_colours() -> None:
    """Mean and covariance are those of samples of both, mixed evenly in every share."""
    rng = np.random.default_rng(2)
    means, spread = rng.normal(0, 1, (2, 3)), np.diag([0.1, 0.2, 0.3])
    one, other = (_Colours(m[None, None], spread[None, None]) for m in means)
    part = rng.uniform(0, 1, (200_000, 1))
    samples = part * means[0] + (1 - part) * means[1]
    samples += rng.multivariate_normal(np.zeros(3), spread, len(samples))
    mixed = one.mixed_with(other)
    np.testing.assert_allclose(mixed.mean[0, 0], samples.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(mixed.covariance[0, 0], np.cov(samples.T), atol=0.01)
