"""The smooth field under the atlas: what it keeps, and where it goes."""

import numpy as np

from unlit.output.base_tone import Surface, base_tone

SIDE = 41  # vertices; half a centimetre apart


def plane() -> tuple[np.ndarray, Surface]:
    """Positions (V, 3) of a square of 20 cm about 0, and its surface."""
    x, y = np.meshgrid(*2 * [np.linspace(-10, 10, SIDE)], indexing="xy")
    position = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    first = np.stack([corner, corner + 1, corner + SIDE], axis=1)
    second = np.stack([corner + 1, corner + SIDE + 1, corner + SIDE], axis=1)
    return position, Surface.of(position, np.concatenate([first, second]))


def twins() -> np.ndarray:
    return np.arange(SIDE**2).reshape(SIDE, SIDE)[:, ::-1].ravel()


def test_areas():
    np.testing.assert_allclose(plane()[1].area.sum(), 400)


def test_a_constant_stays_one():
    """Whatever is measured of it."""
    position, surface = plane()
    values = np.full((len(position), 1), -0.7)
    none = np.zeros(len(position))
    found = base_tone(surface, values, (position[:, 0] > 3) * 1.0, values, twins(), none)
    np.testing.assert_allclose(found.field, -0.7, atol=1e-5)


def test_it_follows_the_measured_and_returns_to_the_typical():
    """Smoothly: no step at the edge of what is known."""
    position, surface = plane()
    x = position[:, 0]
    typical, none = np.zeros((len(x), 1)), np.zeros(len(x))
    field = base_tone(surface, typical + 1, (x > 3) * 1.0, typical, twins(), none).field[:, 0]
    assert field[x > 5].min() > 0.95
    assert field[x < -9].max() < 0.5
    steps = np.diff(field.reshape(SIDE, SIDE), axis=1)
    assert steps.min() > -1e-6
    assert steps.max() < 0.12


def test_changes_are_mirrored_not_levels():
    """A half in other light: its slope comes over, its level stays where it was measured."""
    position, surface = plane()
    x, y = position[:, 0], position[:, 1]
    values = (0.1 * np.abs(x) * (y > 0))[:, None]
    seen = (x > 0) * 1.0
    typical, mirrored = np.zeros((len(x), 1)), (x < 0) * 1.0
    found = base_tone(surface, values, seen, typical, twins(), mirrored)
    field = found.field[:, 0]
    np.testing.assert_array_equal(found.mirrored[:, 0], field[twins()])
    there = (np.abs(x) < 8) & (np.abs(y) > 2) & (np.abs(y) < 8)
    assert np.abs(field - field[twins()])[there].max() < 0.1
    without = base_tone(surface, values, seen, typical, twins(), 0 * seen).field[:, 0]
    assert np.abs(without - without[twins()])[there].max() > 0.3
