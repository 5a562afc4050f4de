"""Colours that a file names without an ICC profile: code points, gamma and chromaticities."""

import io

import cv2
import numpy as np
import pillow_heif
import pytest
from PIL import Image, TiffImagePlugin

from png_file import chrm, chunk, cicp, gama, iccp, png
from profiles import DISPLAY_P3, SRGB_CURVE, grey_tables, matrix
from unlit.color import decode_srgb
from unlit.errors import PhotoError
from unlit.photo.colour_space import hlg, pq
from unlit.photo.photo import read_photo

#: Published matrices to linear sRGB: of BT.2020 (the inverse of BT.2087-0's) and of P3-D65.
BT2020 = np.array(
    [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
)
P3 = np.array([[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]])
D65 = (0.3127, 0.3290)
CODES = {"color_primaries": 9, "matrix_coefficients": 9, "full_range_flag": 1}
COLOURS = np.array([[64, 128, 192], [230, 40, 40], [255, 255, 255], [0, 0, 0]], np.uint8)


def bands(colours=COLOURS):
    """(64, 128, 3): the four colours side by side."""
    return np.tile(np.repeat(colours, 32, axis=0), (64, 1, 1))


def read(tmp_path, data):
    """The four linear colours of a file, and how they were found."""
    path = tmp_path / "photo.x"
    path.write_bytes(data)
    photo = read_photo(path)
    return photo.pixels[32, 16::32], photo.colours


def heic(transfer, pixels, **codes):
    out = io.BytesIO()
    mode = "RGB" if pixels.dtype == np.uint8 else "RGB;16"
    size = (pixels.shape[1], pixels.shape[0])
    file = pillow_heif.from_bytes(mode, size, pixels.tobytes())
    codes = CODES | codes | {"transfer_characteristics": transfer}
    file.save(out, quality=100, chroma=444, **codes)
    return out.getvalue()


def avif(data, primaries, transfer):
    """An AVIF file with other code points."""
    at = data.index(b"colrnclx") + 8
    return data[:at] + bytes((0, primaries, 0, transfer)) + data[at + 4 :]


@pytest.mark.parametrize(
    ("signal", "nits"), [(0.5081, 100), (0.5807, 203), (0.7518, 1000), (0, 0), (1, 10000)]
)
def test_pq_by_published_points(signal, nits):
    """BT.2408-7, table 1, and the ends; 1 is 203 cd/m^2."""
    assert pq(np.array(signal)) == pytest.approx(nits / 203, rel=2e-3)


@pytest.mark.parametrize(("signal", "scene"), [(0, 0), (0.25, 1 / 48), (0.5, 1 / 12), (1, 1)])
def test_hlg_by_published_points(signal, scene):
    """BT.2100's curve; 1 is its value at 75 %, 0.265."""
    assert hlg(np.array(signal)) == pytest.approx(scene / 0.26496, rel=1e-4)
    assert hlg(np.array(0.75)) == 1


@pytest.mark.parametrize(("transfer", "curve"), [(18, hlg), (16, pq)])
@pytest.mark.parametrize("deep", [False, True])
def test_heic_in_bt2020(tmp_path, transfer, curve, deep):
    """HLG and PQ, 8 and 10 bits: light by the curve, primaries to those of sRGB, not clipped."""
    pixels = bands().astype(np.uint16) * 257 if deep else bands()
    found, said = read(tmp_path, heic(transfer, pixels))
    assert said == f"code points 9/{transfer}"
    # The codec is off by a step of 8 or 10 bits.
    low, high = (curve(COLOURS / 255 + step / (1023 if deep else 255)) for step in (-1.5, 1.5))
    wanted = curve(COLOURS / 255) @ BT2020.T
    bound = np.abs(high - low) @ np.abs(BT2020.T) + 2e-3
    assert (np.abs(found - wanted) < bound).all()
    assert found[1].min() < 0
    if not deep:
        assert found[2].min() > 3


def test_heic_without_code_points_is_srgb(tmp_path):
    """Unspecified, and the codes of sRGB itself."""
    for primaries, transfer in ((2, 2), (1, 13)):
        found, said = read(tmp_path, heic(transfer, bands(), color_primaries=primaries))
        assert np.abs(found - decode_srgb(COLOURS / 255)).max() < 0.02
        assert ("9" in said) is False


def test_profile_of_heic_goes_before_its_code_points(tmp_path):
    """As in every iPhone's file: the codes are only for YCbCr there."""
    out = io.BytesIO()
    file = pillow_heif.from_bytes("RGB", (128, 64), bands().tobytes())
    file.info["icc_profile"] = matrix(DISPLAY_P3, SRGB_CURVE)
    file.save(out, quality=100, chroma=444, **CODES, transfer_characteristics=18)
    found, said = read(tmp_path, out.getvalue())
    assert said == "ICC profile"
    assert np.abs(found - decode_srgb(COLOURS / 255) @ P3.T).max() < 0.03


@pytest.mark.parametrize("deep", [False, True])
def test_avif(tmp_path, deep):
    """8 and 10 bits, with the code points of HLG in BT.2020 and of sRGB."""
    if deep:
        stored = (bands()[..., ::-1].astype(float) * 1023 / 255).round().astype(np.uint16)
        options = [cv2.IMWRITE_AVIF_DEPTH, 10, cv2.IMWRITE_AVIF_QUALITY, 100]
        data = cv2.imencode(".avif", stored, options)[1].tobytes()
    else:
        out = io.BytesIO()
        Image.fromarray(bands()).save(out, "AVIF", quality=100, subsampling="4:4:4")
        data = out.getvalue()
    found, _ = read(tmp_path, avif(data, 1, 13))
    step = 1 / (1023 if deep else 255)
    assert np.abs(found - decode_srgb(COLOURS / 255)).max() < 5 * step
    found, said = read(tmp_path, avif(data, 9, 18))
    assert said == "code points 9/18"
    wanted = hlg(COLOURS / 255) @ BT2020.T
    slopes = np.abs(hlg(COLOURS / 255 + step) - hlg(COLOURS / 255)) @ np.abs(BT2020.T)
    assert (np.abs(found - wanted) < 4 * slopes + 2e-3).all()


def test_avif_is_turned_upright(tmp_path):
    """By the turn in the container."""
    exif = Image.Exif()
    exif[274] = 6
    out = io.BytesIO()
    Image.fromarray(bands()).save(out, "AVIF", exif=exif)
    (tmp_path / "x.avif").write_bytes(out.getvalue())
    assert read_photo(tmp_path / "x.avif").pixels.shape == (128, 64, 3)


@pytest.mark.parametrize(
    ("codes", "wanted"),
    [
        ((12, 13, 0, 1), decode_srgb(COLOURS / 255) @ P3.T),
        ((9, 16, 0, 1), pq(COLOURS / 255) @ BT2020.T),
        ((9, 18, 0, 1), hlg(COLOURS / 255) @ BT2020.T),
        ((9, 8, 0, 1), COLOURS / 255 @ BT2020.T),
        ((1, 13, 0, 1), decode_srgb(COLOURS / 255)),
        ((2, 2, 0, 1), decode_srgb(COLOURS / 255)),
        ((1, 4, 0, 1), (COLOURS / 255) ** 2.2),
        ((1, 1, 0, 1), np.where(COLOURS < 21, 0, ((COLOURS / 255 + 0.099) / 1.099) ** (1 / 0.45))),
        ((1, 8, 0, 0), np.clip((COLOURS - 16.0) / 219, 0, 1.1)),
    ],
)
@pytest.mark.parametrize("deep", [False, True])
def test_png_by_code_points(tmp_path, codes, wanted, deep):
    """To the formulas' last digits, at 8 and 16 bits, in limited range, too."""
    pixels = bands().astype(np.uint16) * 257 if deep else bands()
    found, _ = read(tmp_path, png(pixels, 2, cicp(*codes)))
    # In 16 bits the limits are 16 and 235 times 256 of 65535, not 257.
    tolerance = 5e-3 if deep and not codes[3] else 5e-4 * max(1, np.abs(wanted).max())
    np.testing.assert_allclose(found, wanted, atol=tolerance)


@pytest.mark.parametrize(
    ("chunks", "wanted"),
    [
        ([gama(1.0)], COLOURS / 255),
        ([gama(1 / 1.8)], (COLOURS / 255) ** 1.8),
        ([gama(0.45455)], decode_srgb(COLOURS / 255)),
        ([gama(0)], decode_srgb(COLOURS / 255)),
        ([gama(1.0), chunk(b"sRGB", b"\0")], decode_srgb(COLOURS / 255)),
        (
            [gama(1.0), chrm(*D65, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)],
            COLOURS / 255 @ P3.T,
        ),
        (
            [chrm(*D65, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)],
            decode_srgb(COLOURS / 255) @ P3.T,
        ),
        (
            [gama(0.45455), chrm(*D65, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)],
            decode_srgb(COLOURS / 255),
        ),
    ],
)
@pytest.mark.parametrize("deep", [False, True])
def test_png_by_gamma_and_chromaticities(tmp_path, chunks, wanted, deep):
    """Either, or both; sRGB goes before them; a gamma of 0 says nothing."""
    pixels = bands().astype(np.uint16) * 257 if deep else bands()
    found, _ = read(tmp_path, png(pixels, 2, *chunks))
    np.testing.assert_allclose(found, wanted, atol=5e-4)


TABLE = tuple(np.rint(65535 * np.linspace(0, 1, 256) ** 1.8).astype(int).tolist())
P3_TAGS = {318: D65, 319: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06)}


def tiff(tags, **options):
    out = io.BytesIO()
    entries = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in tags.items():
        entries[tag] = value
        entries.tagtype[tag] = 3 if tag == 301 else 5
    Image.fromarray(bands()).save(out, "TIFF", tiffinfo=entries, **options)
    return out.getvalue()


@pytest.mark.parametrize(
    ("tags", "wanted"),
    [
        ({301: TABLE}, (COLOURS / 255) ** 1.8),
        ({301: 3 * TABLE}, (COLOURS / 255) ** 1.8),
        (P3_TAGS, decode_srgb(COLOURS / 255) @ P3.T),
        ({301: TABLE, **P3_TAGS}, (COLOURS / 255) ** 1.8 @ P3.T),
    ],
)
def test_tiff_by_its_tags(tmp_path, tags, wanted):
    """A curve, primaries, both; an ICC profile goes before them."""
    found, said = read(tmp_path, tiff(tags))
    assert said == "TIFF tags"
    np.testing.assert_allclose(found, wanted, atol=5e-4)
    profile = matrix(DISPLAY_P3, SRGB_CURVE)
    assert read(tmp_path, tiff(tags, icc_profile=profile))[1] == "ICC profile"


@pytest.mark.parametrize("tags", [{301: 2 * TABLE + TABLE[::-1]}, {301: (5,)}, {318: (0.3, 0.0)}])
def test_tiff_with_tags_that_make_no_sense(tmp_path, tags):
    """Refused."""
    with pytest.raises(PhotoError, match="cannot be read right"):
        read(tmp_path, tiff(tags))


def test_another_white_becomes_white(tmp_path):
    """Primaries of an equal-energy white: grey stays grey."""
    white = chrm(1 / 3, 1 / 3, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)
    found, _ = read(tmp_path, png(bands(), 2, gama(1.0), white))
    np.testing.assert_allclose(found[2], 1, atol=1e-5)


def test_priority_of_png_chunks(tmp_path):
    """cICP, then the profile, then sRGB, then gamma."""
    said = [cicp(9, 16, 0, 1), iccp(matrix(DISPLAY_P3, SRGB_CURVE)), gama(1.0)]
    found = [read(tmp_path, png(bands(), 2, *said[at:]))[1] for at in range(3)]
    assert found == ["code points 9/16", "ICC profile", "gAMA 1"]


def test_adobe_rgb_of_a_camera(tmp_path):
    """Marked in EXIF alone; an ICC profile goes before it."""
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 0xFFFF
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    image = Image.fromarray(bands())
    for profile, said in ((None, "Adobe RGB (EXIF)"), (matrix(DISPLAY_P3, SRGB_CURVE), "ICC")):
        out = io.BytesIO()
        image.save(out, "JPEG", quality=100, subsampling=0, exif=exif, icc_profile=profile)
        found, colours = read(tmp_path, out.getvalue())
        assert colours.startswith(said)
        if profile is None:
            # Adobe RGB has the red and blue of sRGB, so only its green leaves the gamut.
            linear = (COLOURS / 255) ** 2.19921875
            wanted = [1.39836, -0.39836, 0] @ linear.T, linear[:, 1]
            np.testing.assert_allclose(found[:, :2], np.stack(wanted, axis=1), atol=0.02)


@pytest.mark.parametrize(("transfer", "curve"), [(16, pq), (18, hlg), (13, None)])
def test_hdr_profile(tmp_path, transfer, curve):
    """By the code points in it, since its tables squeeze the highlights; only for PQ and HLG."""
    points = b"cicp\0\0\0\0" + bytes((9, transfer, 0, 1))
    tables = grey_tables(3, b"RGB ", {b"cicp": points})
    found, said = read(tmp_path, png(bands(), 2, iccp(tables)))
    if curve is None:
        assert said == "ICC profile (tables, 8 bits)"
        return
    assert said == f"code points 9/{transfer}"
    wanted = curve(COLOURS / 255) @ BT2020.T
    np.testing.assert_allclose(found, wanted, atol=5e-4 * max(1, wanted.max()))


def test_grey_png_with_gamma(tmp_path):
    """One channel, and the primaries do not matter."""
    grey = np.full((64, 128, 1), 100, np.uint8)
    found, _ = read(tmp_path, png(grey, 0, gama(1.0), chrm(*D65, 0.7, 0.3, 0.2, 0.7, 0.1, 0.1)))
    np.testing.assert_allclose(found, 100 / 255, atol=1e-5)


@pytest.mark.parametrize(
    ("chunks", "why"),
    [
        ([cicp(10, 13, 0, 1)], "code points 10/13"),
        ([cicp(1, 9, 0, 1)], "code points 1/9"),
        ([cicp(9, 16, 9, 1)], "is not RGB"),
        ([chunk(b"cICP", b"\x09")], "damaged cICP"),
        ([gama(2000)], "gAMA is 2000"),
        ([chrm(0.3, 0, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)], "no colours"),
        ([chrm(*D65, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3)], "no colours|hardly"),
    ],
)
def test_colours_that_cannot_be_read_right_are_refused(tmp_path, chunks, why):
    """With the remedy, not read in some other way."""
    with pytest.raises(PhotoError, match=why) as error:
        read(tmp_path, png(bands(), 2, *chunks))
    assert "save it as sRGB" in str(error.value)
    assert "\n" not in str(error.value)
