"""What is painted on rendered skin: bounded, in its place, and the same for the same seed."""

import numpy as np
import pytest
import skin_looks
from skin_looks import skin_looks as painted

from drawn_face import SIZE, drawn_landmarks, inside
from unlit.perception.topology import FACE_OVAL, LIPS_OUTER, NOSE_BASE

LANDMARKS = drawn_landmarks()
OVAL = inside(FACE_OVAL, LANDMARKS)
ROWS = np.arange(SIZE)[:, None]


def test_the_same_seed_gives_the_same_skin() -> None:
    """Finite; shine is never negative."""
    for seed in range(8):
        (one, shine), (other, _) = (
            painted(LANDMARKS, SIZE, np.random.default_rng(seed)) for _ in range(2)
        )
        np.testing.assert_array_equal(one, other)
        assert one.shape == (SIZE, SIZE, 3) and shine.shape == (SIZE, SIZE, 1)
        assert one.dtype == np.float32 and np.isfinite(one).all()
        assert shine.min() >= 0 and shine.max() < 5


def test_a_shaved_beard_is_dark_below_the_nose_and_not_on_the_lips() -> None:
    """Nothing above the nose; never darker than a short beard is."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        shade = skin_looks._shaved(LANDMARKS, SIZE, 250.0, rng).mean(axis=-1)
        upper = OVAL & (LANDMARKS[NOSE_BASE, 1] - 40 > ROWS)
        lower = OVAL & (LANDMARKS[NOSE_BASE, 1] + 10 < ROWS)
        assert np.abs(shade[upper]).max() < 0.02
        assert -0.5 < shade[lower].mean() < 0
        assert abs(shade[inside(LIPS_OUTER, LANDMARKS)].mean()) < abs(shade[lower].mean())


def test_folds_are_darker_than_their_surroundings() -> None:
    """A line through points darkens them most."""
    points = np.array([[60.0, 60.0], [90.0, 120.0], [95.0, 180.0]])
    line = skin_looks._line(points, SIZE, 3.0, np.random.default_rng(1))
    on = np.mean([line[round(y), round(x)] for x, y in points])
    assert line.min() >= 0 and on > 5 * line.mean()


def test_shine_has_no_colour_and_lies_on_the_face() -> None:
    """Most of it inside the oval."""
    shine = skin_looks._shine(LANDMARKS, SIZE, 250.0, np.random.default_rng(2))[..., 0]
    assert shine[OVAL].sum() > 0.6 * shine.sum() > 0


@pytest.mark.parametrize("sigma", [0.7, 12.0])
def test_noise_has_unit_deviation(sigma: float) -> None:
    """Whatever its scale."""
    assert skin_looks._noise(128, sigma, np.random.default_rng(3)).std() == pytest.approx(1)
