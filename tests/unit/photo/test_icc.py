"""icc.py: matrix profiles against LittleCMS and against what the colour spaces are known to be."""

import io

import numpy as np
import pytest
from PIL import Image, ImageCms

from profiles import DISPLAY_P3, SRGB, SRGB_CURVE, build, curv, matrix, para, xyz
from unlit.color import decode_srgb, encode_srgb
from unlit.photo.icc import ProfileError, matrix_profile, srgb_profile

X = np.linspace(0, 1, 256)


def linear(profile, rgb8):
    curves = np.stack([profile.curves[i][rgb8[..., i]] for i in range(3)], axis=-1)
    return curves if profile.matrix is None else curves @ profile.matrix.T


def test_display_p3_red_and_white():
    """White stays white; the red of P3 lies outside sRGB: (1.2249, -0.0420, -0.0196)."""
    profile = matrix_profile(matrix(DISPLAY_P3, SRGB_CURVE), 256)
    np.testing.assert_allclose(linear(profile, np.full((1, 3), 255)), np.ones((1, 3)), atol=1e-3)
    red = linear(profile, np.array([[255, 0, 0]]))
    np.testing.assert_allclose(red, [[1.2249, -0.0420, -0.0196]], atol=1e-3)


@pytest.mark.parametrize(
    "curve",
    [SRGB_CURVE, para(0, 2.2), curv(563), curv(*range(0, 65536, 257)), curv()],
    ids=["sRGB", "power", "gamma", "table", "identity"],
)
def test_agrees_with_littlecms(curve):
    """Inside the gamut both must give the same 8-bit sRGB, whatever the kind of curve."""
    data = matrix(DISPLAY_P3, curve)
    rng = np.random.default_rng(0)
    pixels = rng.integers(90, 170, (32, 32, 3), dtype=np.uint8)
    theirs = ImageCms.profileToProfile(
        Image.fromarray(pixels),
        ImageCms.ImageCmsProfile(io.BytesIO(data)),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    ours = 255 * encode_srgb(linear(matrix_profile(data, 256), pixels))
    assert np.abs(ours - np.asarray(theirs)).max() < 1.1


@pytest.mark.parametrize(
    "data",
    [matrix(SRGB, SRGB_CURVE), ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()],
    ids=["crafted", "LittleCMS"],
)
def test_srgb_profile_is_the_standard_itself(data):
    """A picture with an sRGB profile and one without must be the same to the last bit."""
    profile = matrix_profile(data, 65536)
    assert profile.matrix is None
    np.testing.assert_array_equal(profile.curves, srgb_profile(65536).curves)


def test_parametric_forms_agree():
    """The same curve written in each of the five forms."""
    g, a, b = 2.4, 1 / 1.055, 0.055 / 1.055
    above = X >= 0.04045
    wanted = decode_srgb(X)
    forms = (
        para(3, g, a, b, 1 / 12.92, 0.04045),
        para(4, g, a, b, 1 / 12.92, 0.04045, 0, 0),
        para(1, g, a, b),
        para(2, g, a, b, 0),
    )
    for form in forms:
        curve = matrix_profile(matrix(DISPLAY_P3, form), 256).curves[1]
        np.testing.assert_allclose(curve[above], wanted[above], atol=1e-4)
    for form in forms[:2]:
        curve = matrix_profile(matrix(DISPLAY_P3, form), 256).curves[1]
        np.testing.assert_allclose(curve, wanted, atol=1e-4)


def test_grey_profile():
    """One curve, no matrix."""
    profile = matrix_profile(build({b"kTRC": para(0, 1.8)}, space=b"GRAY"), 256)
    assert profile.matrix is None
    np.testing.assert_allclose(profile.curves, (X**1.8)[None], atol=1e-4)


P3 = matrix(DISPLAY_P3, SRGB_CURVE)


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"short", P3[:100], P3[:140], P3[:-40]),
        P3.replace(b"acsp", b"xxxx"),
        matrix(DISPLAY_P3, para(9, 1.0)),
        matrix(DISPLAY_P3, para(1, 2.2, 0.0, 0.1)),
        matrix(DISPLAY_P3, b"curv\0\0\0\0\xff\xff\xff\xff"),
        matrix(DISPLAY_P3, b"mft2" + bytes(20)),
        build({b"rXYZ": xyz((1, 1, 1))}),
        build({}, space=b"CMYK"),
        build({b"kTRC": b""}, space=b"GRAY"),
    ],
)
def test_damaged_or_other_profiles(data):
    """Hostile or unsuitable bytes end in ProfileError, never in anything else."""
    with pytest.raises(ProfileError):
        matrix_profile(data, 256)
