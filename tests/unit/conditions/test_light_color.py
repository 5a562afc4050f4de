"""The light's colour from gloss, on pictures made by the dichromatic model itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from unlit.conditions.illuminant import of_temperature, temperature
from unlit.conditions.light_color import Slopes, most_likely, slopes
from unlit.settings.conditions import LightColorEstimate

SIZE = 256
HOW = LightColorEstimate()
ALBEDO = np.array([0.5, 0.32, 0.24])


def scene(color, seed=0, gloss=1.0, albedo=ALBEDO):
    """A rough ball under a lamp: I = L (a E + gloss S), with blotches and freckles in a.

    Returns image (H, W, 3), E, S, and the disc.
    """
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[0:SIZE, 0:SIZE] + 0.5) / SIZE * 2.4 - 1.2
    disc = x**2 + y**2 < 0.9

    def noise(sigma):
        field = ndimage.gaussian_filter(rng.standard_normal((SIZE, SIZE)), sigma)
        return field / field.std()

    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0.01))
    e = np.maximum(0.3 * x + 0.3 * y + 0.9 * z, 0.01) * 0.9
    s = 0.03 * np.exp(0.8 * noise(9))  # many highlights, as of bumps
    body = np.log(albedo) + 0.03 * noise(15)[..., None] * (0.3, -1.0, -0.8)
    body = body + 0.03 * noise(3)[..., None]
    body = body - 0.3 * (noise(1.5) > 2.3)[..., None]
    image = color * (np.exp(body) * e[..., None] + gloss * s[..., None])
    return image, e, s, disc & (e > 0.15)


@pytest.mark.parametrize(("kelvin", "seed"), [(2700, 0), (4000, 1), (6500, 2), (10000, 3)])
def test_the_light_is_found(kelvin, seed):
    """Within 20 mired, whatever the strength of the lamp."""
    image, e, s, disc = scene(0.7 * of_temperature(kelvin), seed)
    found = slopes(image, e, s, disc, HOW)
    assert found is not None
    mired, deviation, _ = most_likely(found, HOW)
    assert mired == pytest.approx(1e6 / kelvin, abs=20)
    assert deviation < 20


def test_another_skin():
    image, e, s, disc = scene(of_temperature(3200), albedo=np.array([0.2, 0.35, 0.1]))
    found = slopes(image, e, s, disc, HOW)
    assert found is not None
    assert most_likely(found, HOW)[0] == pytest.approx(1e6 / 3200, abs=20)


def test_errors_of_the_diffuse_shading_cancel():
    """The same wrong factor in all channels of the picture, as of shadows that E lacks."""
    image, e, s, disc = scene(of_temperature(2700))
    x = np.linspace(0, 1, SIZE)
    wrong = 1 + 0.3 * np.sin(9 * x)[:, None] * np.cos(11 * x)
    found = slopes(image * wrong[..., None], e, s, disc, HOW)
    assert found is not None
    assert most_likely(found, HOW)[0] == pytest.approx(1e6 / 2700, abs=25)


def test_without_gloss_nothing_is_told():
    """Reddish skin under white light, or the reverse: nobody knows, so nothing is claimed."""
    image, e, s, disc = scene(of_temperature(2700), gloss=0.0)
    found = slopes(image, e, s, disc, HOW)
    assert found is not None
    assert most_likely(found, HOW)[2] < 6


def test_too_little_skin():
    image, e, s, disc = scene(np.ones(3))
    assert slopes(image, e, s, disc & (np.arange(SIZE) < 12), HOW) is None


def test_the_deviation_counts():
    """The same slopes, more uncertain, leave white as likely."""
    lamp = of_temperature(4000)
    share = lamp / (lamp * ALBEDO)
    value = share[[0, 2]] - share[1]
    sure = Slopes(value, 0.01 * np.eye(2), lamp * ALBEDO)
    mired, _, excess = most_likely(sure, HOW)
    assert mired == pytest.approx(250, abs=3)
    assert excess > most_likely(replace(sure, covariance=np.eye(2)), HOW)[2]
    assert temperature(lamp) == pytest.approx(4000, rel=0.01)
