"""color.py: the sRGB curve at its anchors, its inverse, and luminance."""

import numpy as np
import pytest

from unlit.color import decode_srgb, encode_srgb, luminance


def test_published_anchors():
    """Values that the standard fixes, and mid grey, so that the curve is not some other gamma."""
    linear = np.array([0.0, 0.0031308, 0.21404114, 1.0])
    encoded = np.array([0.0, 0.04045, 0.5, 1.0])
    np.testing.assert_allclose(encode_srgb(linear), encoded, atol=2e-6)
    np.testing.assert_allclose(decode_srgb(encoded), linear, atol=2e-6)


def test_inverse_also_outside_the_unit_interval():
    """Highlights above 1 and out-of-gamut negatives must survive a round trip."""
    linear = np.linspace(-0.5, 8, 2001, dtype=np.float32)
    np.testing.assert_allclose(decode_srgb(encode_srgb(linear)), linear, rtol=2e-6, atol=2e-7)


def test_monotonic_without_warning():
    """No fold or NaN anywhere: the image loss differentiates through this curve."""
    with np.errstate(all="raise"):
        encoded = encode_srgb(np.linspace(-1, 4, 5001))
    assert (np.diff(encoded) > 0).all()


@pytest.mark.parametrize("function", [encode_srgb, decode_srgb])
def test_float32_whatever_comes_in(function):
    """float32 is the contract: a float64 would double every map in memory."""
    assert function(0.5).dtype == np.float32
    assert function(np.ones((2, 3), np.float64)).dtype == np.float32


def test_all_8_bit_values_come_back():
    """Decoding and encoding an 8-bit picture must change no pixel."""
    values = np.arange(256)
    assert (np.rint(255 * encode_srgb(decode_srgb(values / 255))) == values).all()


def test_luminance_of_the_primaries():
    """Weights sum to one and rank green, red, blue."""
    red, green, blue = luminance(np.eye(3))
    assert green > red > blue > 0
    assert luminance(np.ones((4, 5, 3))).shape == (4, 5)
    assert luminance([1, 1, 1]) == pytest.approx(1)
