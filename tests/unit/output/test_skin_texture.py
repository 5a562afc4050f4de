"""Synthesised skin has the statistics of the measured, and nothing else."""

import numpy as np
from scipy import ndimage

from unlit.output.skin_texture import skin_texture

SIZE, CENTIMETRE = 200, 16.0


def channels(seed: int = 0) -> np.ndarray:
    """Fine noise of a colour and a fourth channel that goes with it, on a broad slope."""
    rng = np.random.default_rng(seed)
    fine = ndimage.gaussian_filter(rng.standard_normal((SIZE, SIZE)), 1.0)
    fine /= fine.std()
    slope = np.linspace(-3, 3, SIZE)[:, None]
    colour = [factor * fine + slope for factor in (0.1, 0.1, 0.2)]
    return np.stack([*colour, -0.05 * fine], axis=2).astype(np.float32)


def test_it_has_the_spread_and_the_correlation_of_the_patches():
    """The slope is no texture; a dark pore stays a rough one."""
    texture = skin_texture(channels(), np.ones((SIZE, SIZE), np.float32), CENTIMETRE)
    assert texture is not None
    noise = texture.levels[0].reshape(-1, 4)
    np.testing.assert_allclose(noise.std(axis=0), [0.1, 0.1, 0.2, 0.05], rtol=0.35)
    assert np.abs(noise.mean(axis=0)).max() < 1e-3
    assert np.corrcoef(noise.T)[0, 3] < -0.95


def test_it_repeats_nothing_of_the_photo_but_its_statistics():
    """The same photo gives the same texture; a patch is not found in it."""
    one, two = (skin_texture(channels(), np.ones((SIZE, SIZE)), CENTIMETRE) for _ in range(2))
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.levels[0], two.levels[0])
    fine = np.kron(channels()[60:84, 60:84, 3], np.ones((2, 2)))
    noise = one.levels[0][..., 3]
    match = ndimage.correlate(noise, fine - fine.mean(), mode="wrap")
    assert match.max() < 0.7 * fine.std() ** 2 * fine.size


def test_no_patch_no_texture():
    """A face of which no square of skin was seen well."""
    evidence = np.zeros((SIZE, SIZE), np.float32)
    evidence[:10] = 1
    assert skin_texture(channels(), evidence, CENTIMETRE) is None


def test_looked_up_on_any_slope_it_keeps_its_spread_and_coarse_texels_its_mean():
    """Where planes blend, too; a texel that covers much averages the noise away."""
    texture = skin_texture(channels(), np.ones((SIZE, SIZE), np.float32), CENTIMETRE)
    assert texture is not None
    rng = np.random.default_rng(1)
    point = rng.uniform(-10, 10, (20000, 3))
    for normal in ((0, 0, 1), (0.7, 0.1, 0.7), (0.6, 0.6, 0.52)):
        unit = np.tile(np.array(normal) / np.linalg.norm(normal), (len(point), 1))
        fine = texture.at(point, unit, np.full(len(point), 0.02))
        np.testing.assert_allclose(fine.std(axis=0), [0.1, 0.1, 0.2, 0.05], rtol=0.4)
        coarse = texture.at(point, unit, np.full(len(point), 1.0))
        assert coarse.std(axis=0)[0] < 0.3 * fine.std(axis=0)[0]
