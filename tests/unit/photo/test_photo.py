"""photo.py: every format on files made on the fly, colours, EXIF, bad input, and the crop."""

import functools
import io
import os
import struct
import warnings

import cv2
import numpy as np
import pillow_heif
import pytest
from PIL import Image

from png_file import chunk, iccp, png
from profiles import DISPLAY_P3, SRGB, SRGB_CURVE, build, grey_tables, matrix, para
from unlit.color import decode_srgb, encode_srgb
from unlit.errors import FaceError, PhotoError
from unlit.photo.crop import Crop, face_crop
from unlit.photo.photo import Photo, focal_from_exif, read_photo

HEIGHT, WIDTH = 70, 96


def picture(levels=256, channels=3):
    """Smooth colours without symmetry (so that every flip shows), and strong in every channel."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] / HEIGHT
    waves = [0.2 + 0.35 * x + 0.1 * y, 0.7 - 0.4 * y, 0.3 + 0.3 * x * y, 0.4 + 0.5 * y]
    stack = np.stack(waves[:channels], axis=-1)
    kind = np.uint8 if levels == 256 else np.uint16
    return np.rint(stack * (levels - 1)).astype(kind)


def tiff16(pixels, orientation=1):
    """A 16-bit RGB TIFF of one strip, written by hand."""
    body = pixels.astype("<u2").tobytes()
    bits_at = 8
    strip_at = 14
    entries = [
        (256, 3, 1, pixels.shape[1]),
        (257, 3, 1, pixels.shape[0]),
        (258, 3, 3, bits_at),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (273, 4, 1, strip_at),
        (274, 3, 1, orientation),
        (277, 3, 1, 3),
        (278, 3, 1, pixels.shape[0]),
        (279, 4, 1, len(body)),
    ]
    directory = struct.pack("<H", len(entries))
    directory += b"".join(struct.pack("<HHII", *entry) for entry in entries) + bytes(4)
    header = b"II*\0" + struct.pack("<I", strip_at + len(body)) + struct.pack("<3H", 16, 16, 16)
    return header + body + directory


def oriented_exif(orientation):
    exif = Image.Exif()
    exif[274] = orientation
    return exif


def stored_as(upright, orientation):
    """The array that a camera held this way stores: the table of EXIF 2.32, tag 274."""
    turned = upright.swapaxes(0, 1)
    return np.ascontiguousarray(
        {
            1: upright,
            2: upright[:, ::-1],
            3: upright[::-1, ::-1],
            4: upright[::-1],
            5: turned,
            6: turned[::-1],
            7: turned[::-1, ::-1],
            8: turned[:, ::-1],
        }[orientation]
    )


def save(path, image, fmt, **options):
    if fmt == "HEIF":
        pillow_heif.from_pillow(image).save(path, **options)
    else:
        image.save(path, fmt, **options)
    return path


@pytest.mark.parametrize(
    ("fmt", "options", "tolerance"),
    [
        ("PNG", {}, 0),
        ("TIFF", {}, 0),
        ("TIFF", {"compression": "tiff_lzw"}, 0),
        ("WEBP", {"lossless": True}, 0),
        ("WEBP", {"quality": 95}, 6),
        ("JPEG", {"quality": 98}, 4),
        ("JPEG", {"quality": 98, "progressive": True}, 4),
        ("HEIF", {"quality": 98}, 4),
    ],
)
def test_8_bit_formats(tmp_path, fmt, options, tolerance):
    """The values of the file, decoded by the sRGB curve; lossless formats to the last bit."""
    pixels = picture()
    path = save(tmp_path / "photo.x", Image.fromarray(pixels), fmt, **options)
    photo = read_photo(path)
    assert photo.pixels.dtype == np.float32
    assert photo.alpha is None
    assert photo.focal is None
    assert photo.source == "photo.x"
    assert np.abs(photo.encoded8().astype(int) - pixels).max() <= tolerance
    if tolerance == 0:
        np.testing.assert_array_equal(photo.pixels, decode_srgb(np.linspace(0, 1, 256))[pixels])


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_16_bit_png(tmp_path, channels):
    """All 16 bits survive in grey, grey with alpha, RGB, RGB with alpha."""
    pixels = picture(65536, channels)
    path = tmp_path / "deep.png"
    path.write_bytes(png(pixels, {1: 0, 2: 4, 3: 2, 4: 6}[channels]))
    photo = read_photo(path)
    colours = pixels[..., : 3 if channels > 2 else 1]
    back = np.rint(65535 * encode_srgb(photo.pixels))
    assert np.abs(back - colours).max() <= 1  # float32 has 24 bits, the curve takes some
    assert len(np.unique(photo.pixels)) > 500  # 8 bits would leave 256
    if channels in (2, 4):
        assert photo.alpha is not None
        np.testing.assert_allclose(photo.alpha, pixels[..., -1] / 65535, atol=1e-6)
    else:
        assert photo.alpha is None


@pytest.mark.parametrize("orientation", range(1, 9))
def test_16_bit_tiff_in_every_orientation(tmp_path, orientation):
    """Pillow and OpenCV each turn TIFF files; together they must turn them once."""
    pixels = picture(65536)
    path = tmp_path / "deep.tif"
    path.write_bytes(tiff16(stored_as(pixels, orientation), orientation))
    back = np.rint(65535 * encode_srgb(read_photo(path).pixels))
    assert back.shape == pixels.shape
    assert np.abs(back - pixels).max() <= 1


@pytest.mark.parametrize("fmt", ["PNG", "TIFF", "WEBP", "JPEG"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation(tmp_path, fmt, orientation):
    """However the camera was held, the photo comes out upright."""
    pixels = picture()
    options = {"JPEG": {"quality": 98}, "WEBP": {"lossless": True}}.get(fmt, {})
    stored = Image.fromarray(stored_as(pixels, orientation))
    path = save(tmp_path / "photo", stored, fmt, exif=oriented_exif(orientation), **options)
    back = read_photo(path).encoded8()
    assert back.shape == pixels.shape
    assert np.abs(back.astype(int) - pixels).max() <= (6 if fmt == "JPEG" else 0)


def test_orientation_of_16_bit_png(tmp_path):
    """OpenCV must not turn it as well."""
    pixels = picture(65536)
    exif = oriented_exif(6).tobytes().removeprefix(b"Exif\0\0")
    path = tmp_path / "deep.png"
    path.write_bytes(png(stored_as(pixels, 6), 2, chunk(b"eXIf", exif)))
    back = np.rint(65535 * encode_srgb(read_photo(path).pixels))
    assert back.shape == pixels.shape
    assert np.abs(back - pixels).max() <= 1


def test_orientation_of_heic_is_applied_once(tmp_path):
    """In HEIC the turn is part of the format and the EXIF entry repeats it."""
    pixels = picture()
    image = Image.fromarray(stored_as(pixels, 6))
    exif = oriented_exif(6).tobytes()
    path = save(tmp_path / "photo.heic", image, "HEIF", quality=98, exif=exif)
    back = read_photo(path).encoded8()
    assert back.shape == pixels.shape
    assert np.abs(back.astype(int) - pixels).max() <= 4


def test_10_bit_heic(tmp_path):
    """Phones write 10 bits; white must still be 1."""
    pixels = np.full((HEIGHT, WIDTH, 3), 65535, np.uint16)
    pixels[:, : WIDTH // 2] = 30000
    path = tmp_path / "photo.heic"
    file = pillow_heif.from_bytes("RGB;16", (WIDTH, HEIGHT), pixels.tobytes())
    file.save(path, quality=100)
    encoded = encode_srgb(read_photo(path).pixels)
    assert encoded[:, -10:].mean() == pytest.approx(1, abs=4e-3)
    assert encoded[:, :10].mean() == pytest.approx(30000 / 65535, abs=4e-3)


@pytest.mark.parametrize("mode", ["L", "1", "P", "LA", "RGBA", "CMYK", "PA"])
def test_pixel_types(tmp_path, mode):
    """Grey, bilevel, palette, alpha, CMYK: always three channels of linear sRGB."""
    alpha = picture(channels=4)[..., 3]
    image = Image.fromarray(picture())
    if mode in ("LA", "RGBA", "PA"):
        image = image.convert("RGBA")
        image.putalpha(Image.fromarray(alpha))
        image = image if mode == "RGBA" else image.convert("LA" if mode == "LA" else "RGBA")
        if mode == "PA":
            image = image.quantize(64)
    else:
        image = image.convert(mode)
    fmt = "TIFF" if mode == "CMYK" else "PNG"
    photo = read_photo(save(tmp_path / "photo", image, fmt))
    rgb = np.asarray(image.convert("RGBA"))[..., :3]
    np.testing.assert_array_equal(photo.encoded8(), rgb)
    if mode in ("LA", "RGBA"):
        assert photo.alpha is not None
        np.testing.assert_allclose(photo.alpha, alpha / 255, atol=1e-6)
    else:
        assert (photo.alpha is None) == (mode != "PA")


def test_opaque_alpha_is_no_alpha(tmp_path):
    """A screenshot's all-255 alpha carries nothing."""
    image = Image.fromarray(picture()).convert("RGBA")
    assert read_photo(save(tmp_path / "photo", image, "PNG")).alpha is None


def picture_in_p3():
    """`picture` in encoded Display P3, float."""
    linear = decode_srgb(picture() / 255) @ np.linalg.solve(DISPLAY_P3, SRGB).T
    return encode_srgb(linear)


def test_display_p3_at_8_and_16_bits(tmp_path):
    """The same picture in P3 and in sRGB gives the same linear colours, finer at 16 bits."""
    in_p3 = picture_in_p3()
    profile = matrix(DISPLAY_P3, SRGB_CURVE)
    stored = Image.fromarray(np.rint(255 * in_p3).astype(np.uint8))
    path = save(tmp_path / "p3.png", stored, "PNG", icc_profile=profile)
    photo = read_photo(path)
    assert photo.colours == "ICC profile"
    assert np.abs(encode_srgb(photo.pixels) - picture() / 255).max() < 2 / 255
    name = tmp_path / "deep.png"
    name.write_bytes(png(np.rint(65535 * in_p3).astype(np.uint16), 2, iccp(profile)))
    assert np.abs(encode_srgb(read_photo(name).pixels) - picture() / 255).max() < 6e-4


def test_saturated_p3_leaves_the_gamut_of_srgb(tmp_path):
    """A red that sRGB cannot show keeps its negative components instead of being clipped."""
    image = Image.new("RGB", (WIDTH, HEIGHT), (255, 0, 0))
    profile = matrix(DISPLAY_P3, SRGB_CURVE)
    photo = read_photo(save(tmp_path / "p3.png", image, "PNG", icc_profile=profile))
    np.testing.assert_allclose(photo.pixels[0, 0], (1.2249, -0.0420, -0.0196), atol=1e-3)
    assert tuple(photo.encoded8()[0, 0]) == (255, 0, 0)


def test_heic_with_profile(tmp_path):
    """Phones: HEIC in Display P3."""
    image = Image.fromarray(np.rint(255 * picture_in_p3()).astype(np.uint8))
    image.info["icc_profile"] = matrix(DISPLAY_P3, SRGB_CURVE)
    photo = read_photo(save(tmp_path / "p3.heic", image, "HEIF", quality=98))
    assert photo.colours == "ICC profile"
    assert np.abs(photo.encoded8().astype(int) - picture()).max() <= 12
    assert np.abs(encode_srgb(photo.pixels) - picture() / 255).mean() < 2 / 255


def test_grey_with_grey_profile(tmp_path):
    """The one curve of the profile, not the sRGB curve."""
    grey = picture(channels=1)[..., 0]
    profile = build({b"kTRC": para(0, 1.8)}, space=b"GRAY")
    photo = read_photo(save(tmp_path / "g.png", Image.fromarray(grey), "PNG", icc_profile=profile))
    wanted = np.repeat(((grey / 255) ** 1.8)[..., None], 3, axis=2)
    np.testing.assert_allclose(photo.pixels, wanted, atol=1e-4)


@pytest.mark.parametrize(("mode", "channels"), [("CMYK", 4), ("RGB", 3)])
def test_profile_of_tables_goes_through_littlecms(tmp_path, mode, channels):
    """The tables are obeyed: these ones turn every colour into a grey of known lightness."""
    profile = grey_tables(channels, mode.encode().ljust(4))
    half = (255,) * (channels // 2) + (0,) * (channels - channels // 2)
    image = Image.new(mode, (WIDTH, HEIGHT), half)
    photo = read_photo(save(tmp_path / "x.tif", image, "TIFF", icc_profile=profile))
    assert "tables" in photo.colours
    lightness = 50 if mode == "CMYK" else 100 / 3
    wanted = ((lightness + 16) / 116) ** 3
    np.testing.assert_allclose(photo.pixels, wanted, rtol=0.03)


@pytest.mark.parametrize("profile", [b"no profile at all", grey_tables(4, b"CMYK")])
def test_profile_that_cannot_be_used(tmp_path, profile):
    """Damaged, or of another kind of pixels: told, and the picture is taken for sRGB."""
    image = Image.fromarray(picture())
    photo = read_photo(save(tmp_path / "x.tif", image, "TIFF", icc_profile=profile))
    assert "cannot be used" in photo.colours
    np.testing.assert_array_equal(photo.encoded8(), picture())


@pytest.mark.parametrize(
    ("entries", "size", "wanted"),
    [
        ({0xA405: 50}, (3000, 2000), 50 / 36 * 3000),
        ({0xA405: 50}, (2000, 3000), 50 / 36 * 3000),
        ({0xA405: 50, 0xA002: 6000, 0xA003: 4000}, (3000, 2000), 50 / 36 * 3000),
        ({0xA405: 50, 0xA002: 6000, 0xA003: 4000}, (2000, 2000), None),
        ({0x920A: 85.0, 0xA20E: 160.0, 0xA210: 4}, (5760, 3840), 85 * 160),
        ({0x920A: 85.0, 0xA20E: 4064.0, 0xA210: 2}, (5760, 3840), 85 * 160),
        ({0x920A: 85.0, 0xA20E: 1600.0, 0xA210: 3, 0xA002: 5760, 0xA003: 3840}, (576, 384), 1360),
        ({0x920A: 85.0, 0xA20E: 160.0, 0xA210: 4}, (576, 384), None),
        ({0x920A: 85.0}, (3000, 2000), None),
        ({0xA405: 0, 0x920A: float("nan")}, (3000, 2000), None),
        ({0xA405: "long"}, (3000, 2000), None),
        ({}, (3000, 2000), None),
    ],
)
def test_focal_length(entries, size, wanted):
    """35 mm equivalent, sensor resolution in its units, reduced and cropped pictures, nonsense."""
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(entries)
    focal = focal_from_exif(exif, *size)
    assert focal == (None if wanted is None else pytest.approx(wanted, rel=1e-3))


def test_focal_length_of_a_picture_reduced_by_an_editor():
    """The editor updated one size entry; the other still counts the sensor's pixels."""
    exif = Image.Exif()
    exif.update({256: 2687, 257: 3356})
    sensor = {0x920A: 85.0, 0xA20E: 160.0, 0xA210: 4, 0xA002: 910, 0xA003: 1137}
    exif.get_ifd(0x8769).update(sensor)
    assert focal_from_exif(exif, 910, 1137) == pytest.approx(85 * 160 * 1137 / 3356)


def test_focal_length_from_a_file(tmp_path):
    """It survives being written and read, and counts upright pixels."""
    exif = oriented_exif(6)
    exif.get_ifd(0x8769)[0xA405] = 50
    path = save(tmp_path / "p.jpg", Image.fromarray(picture()), "JPEG", exif=exif)
    photo = read_photo(path)
    assert photo.pixels.shape[:2] == (WIDTH, HEIGHT)
    assert photo.focal == pytest.approx(50 / 43.2666 * np.hypot(WIDTH, HEIGHT), rel=1e-4)


def huge_png():
    """30,000 x 30,000 as its header says; the data would follow."""
    small = png(np.zeros((1, 1, 3), np.uint16), 2)
    header = struct.pack(">IIBBBBB", 30000, 30000, 8, 2, 0, 0, 0)
    return small[:8] + chunk(b"IHDR", header) + small[33:]


def encoded(fmt, **options):
    buffer = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    save(buffer, Image.fromarray(noise), fmt, **options)
    return buffer.getvalue()


@functools.cache
def bad_files():
    jpeg = encoded("JPEG")
    deep = png(picture(65536), 2)
    small = io.BytesIO()
    Image.new("RGB", (20, 200)).save(small, "PNG")
    wide = io.BytesIO()
    Image.new("L", (10001, 10000)).save(wide, "PNG")
    return {
        "text": (b"this is no picture\n" * 10, "not a picture"),
        "empty": (b"", "is empty"),
        "one byte": (b"\xff", "not a picture"),
        "cut JPEG": (jpeg[: len(jpeg) // 2], "damaged or cut off"),
        "JPEG head": (jpeg[:30], "not a picture|damaged"),
        "cut PNG": (encoded("PNG")[:2000], "damaged or cut off"),
        "cut 16-bit PNG": (deep[: len(deep) // 2], "damaged or cut off"),
        "cut 16-bit TIFF": (tiff16(picture(65536))[:5000], "damaged or cut off|not a picture"),
        "cut WebP": (encoded("WEBP")[:1000], "damaged or cut off|not a picture"),
        "cut HEIC": (encoded("HEIF")[:3000], "damaged or cut off"),
        "HEIC head": (encoded("HEIF")[:24], "damaged or cut off"),
        "garbled PNG": (deep[:60] + bytes(40) + deep[100:], "damaged or cut off"),
        "30,000 x 30,000 PNG": (huge_png(), "megapixels"),
        "100.01 megapixels": (wide.getvalue(), "10001 x 10000 pixels, more than 100 megapixels"),
        "too small": (small.getvalue(), "20 x 200 pixels, too small"),
        "script": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 99 99\n", "not a picture"),
    }


@pytest.mark.parametrize("kind", list(bad_files()))
def test_bad_files(tmp_path, capfd, kind):
    """One line that names the file and the trouble; no warning, no word from a decoder."""
    data, message = bad_files()[kind]
    path = tmp_path / "face.jpg"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(PhotoError, match=message) as caught:
            read_photo(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_missing_file_and_folder(tmp_path):
    """Neither is a picture."""
    with pytest.raises(PhotoError, match=r"none\.jpg: no such file"):
        read_photo(tmp_path / "none.jpg")
    with pytest.raises(PhotoError, match="a folder"):
        read_photo(tmp_path)
    with pytest.raises(PhotoError):
        read_photo("\0")


def test_no_permission(tmp_path, monkeypatch):
    """The superuser may read anything, hence the stand-in."""
    path = save(tmp_path / "photo.png", Image.fromarray(picture()), "PNG")
    if hasattr(os, "geteuid") and os.geteuid() != 0:
        path.chmod(0)
    else:

        def refuse(self):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(type(path), "read_bytes", refuse)
    with pytest.raises(PhotoError, match="no permission"):
        read_photo(path)


def test_float_picture_is_refused(tmp_path):
    """Pixels whose meaning is not known are not guessed at."""
    path = tmp_path / "f.tif"
    Image.fromarray(np.zeros((HEIGHT, WIDTH), np.float32)).save(path)
    with pytest.raises(PhotoError, match="not supported"):
        read_photo(path)


def test_test_photos(shared):
    """Real JPEG files: the 8-bit values come back as another decoder gives them."""
    for path in sorted((shared / "data" / "photos").glob("A_0[34]*.jpg")):
        photo = read_photo(path)
        stored = cv2.imread(str(path))
        assert stored is not None
        other = cv2.cvtColor(stored, cv2.COLOR_BGR2RGB)
        assert np.abs(photo.encoded8().astype(int) - other).max() <= 2


# The crop


def square(scale, x, y, resolution):
    return Crop(np.array([[scale, 0, -scale * x], [0, scale, -scale * y]]), resolution)


def test_points_round_trip():
    """Points map back to 1e-6 pixel; the square's corners are the crop's."""
    crop = square(0.3717, 123.456, -7.89, 512)
    xy = np.random.default_rng(0).uniform(-100, 4000, (478, 2))
    np.testing.assert_allclose(crop.inverse_points(crop.points(xy)), xy, atol=1e-6)
    np.testing.assert_allclose(crop.points(crop.origin), (0, 0), atol=1e-9)
    np.testing.assert_allclose(
        crop.inverse_points((512, 512)), crop.origin + 512 / 0.3717, atol=1e-9
    )


def ramp(height, width):
    y, x = np.mgrid[0:height, 0:width] + 0.5
    return np.stack([x, y, 0 * x + 7], axis=-1).astype(np.float32)


@pytest.mark.parametrize("scale", [0.125, 0.31, 0.5, 1.0, 1.7, 4.0])
def test_image_and_points_agree(scale):
    """A picture of its own coordinates, cropped, holds at each pixel the coordinates of its centre.

    This ties the resampling to the half-pixel convention; a shift of half a pixel fails.
    """
    crop = square(scale, 20.3, 31.7, 64)
    centres = np.stack(np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5), axis=-1)
    cropped = crop.image(ramp(700, 700))
    wanted = crop.inverse_points(centres)
    assert np.abs(cropped[..., :2] - wanted).max() < 0.13
    assert np.abs((cropped[..., :2] - wanted).mean(axis=(0, 1))).max() < 0.02
    np.testing.assert_allclose(cropped[..., 2], 7, rtol=1e-6)


def test_reducing_keeps_the_mean():
    """No aliasing: one-pixel stripes reduced eight times are grey, and light is not lost."""
    stripes = np.zeros((256, 256, 3), np.float32)
    stripes[:, ::2] = 1
    small = square(1 / 8, 0, 0, 32).image(stripes)
    np.testing.assert_allclose(small, 0.5, atol=1e-6)
    noise = np.random.default_rng(0).random((300, 300, 1)).astype(np.float32)
    small = square(32 / 300, 0, 0, 32).image(noise)
    assert small.mean() == pytest.approx(noise.mean(), abs=1e-6)


def test_crop_beyond_the_photo_repeats_its_edge():
    """Above the left upper corner all is the corner pixel."""
    photo = ramp(40, 50)
    cropped = square(1, -30, -20, 64).image(photo)
    np.testing.assert_array_equal(cropped[:20, :30], np.broadcast_to(photo[0, 0], (20, 30, 3)))
    np.testing.assert_array_equal(cropped[20:60, 30:], photo[:, :34])
    outside = square(1, 500, 500, 64).image(photo)
    np.testing.assert_array_equal(outside, np.broadcast_to(photo[-1, -1], (64, 64, 3)))


def test_whole_pixels_are_copied():
    """At scale 1 and whole shifts nothing is resampled, and pasting back changes nothing."""
    photo = np.random.default_rng(0).random((90, 120, 3)).astype(np.float32)
    crop = square(1, 13, 9, 64)
    np.testing.assert_array_equal(crop.image(photo), photo[9:73, 13:77])
    back = crop.paste(crop.image(photo), photo, np.ones((64, 64)))
    np.testing.assert_allclose(back, photo, atol=1e-7)


@pytest.mark.parametrize("scale", [0.37, 1.0, 2.3])
def test_paste_where_the_mask_is_and_nowhere_else(scale):
    """Mask 0 leaves the photo bit for bit; mask 1 replaces it; the input is not written to."""
    photo = np.random.default_rng(0).random((200, 220, 3)).astype(np.float32)
    kept = photo.copy()
    crop = square(scale, 40.25, 30.4, 64)
    red = np.broadcast_to(np.array([1, 0, 0], np.float32), (64, 64, 3))
    np.testing.assert_array_equal(crop.paste(red, photo, np.zeros((64, 64))), photo)
    out = crop.paste(red, photo, np.ones((64, 64)))
    centres = np.stack(np.meshgrid(np.arange(220) + 0.5, np.arange(200) + 0.5), axis=-1)
    inside = ((crop.points(centres) > 0) & (crop.points(centres) < 64)).all(axis=-1)
    np.testing.assert_array_equal(out[~inside], photo[~inside])
    np.testing.assert_allclose(
        out[inside], np.broadcast_to([1, 0, 0], out[inside].shape), atol=1e-6
    )
    np.testing.assert_array_equal(photo, kept)


@pytest.mark.parametrize("scale", [0.37, 2.3])
def test_paste_is_the_inverse_of_image(scale):
    """A smooth picture survives crop and paste; a misplacement by half a pixel would not."""
    photo = ramp(200, 220)
    crop = square(scale, -10.75, 15.5, 100)
    back = crop.paste(crop.image(photo), photo, np.ones((100, 100)))
    inner = crop.points(np.stack(np.meshgrid(np.arange(220), np.arange(200)), axis=-1))
    inner = np.array(((inner > 4) & (inner < 96)).all(axis=-1))
    inner[:5] = inner[-5:] = inner[:, :5] = inner[:, -5:] = False  # where the edge is repeated
    assert np.abs(back - photo)[inner].max() < 0.5
    assert np.abs((back - photo)[inner].mean(axis=0)).max() < 0.02


def test_paste_outside_the_photo():
    """A square that misses the photo changes nothing."""
    photo = ramp(40, 50)
    crop = square(1, 400, 400, 64)
    np.testing.assert_array_equal(
        crop.paste(np.zeros((64, 64, 3)), photo, np.ones((64, 64))), photo
    )


def test_crop_refuses_other_maps():
    """Rotation or unequal scales would break the camera of the crop."""
    for bad in ([[1, 0.1, 0], [0, 1, 0]], [[1, 0, 0], [0, 2, 0]], [[-1, 0, 0], [0, -1, 0]]):
        with pytest.raises(ValueError, match="crop"):
            Crop(np.array(bad, dtype=float), 64)


def oval(centre, height, width):
    angle = np.linspace(0, 2 * np.pi, 478)
    return centre + np.stack([width / 2 * np.sin(angle), -height / 2 * np.cos(angle)], axis=1)


def test_face_crop_frames_the_face():
    """The oval takes 0.7 of the height, is centred across, with more room above than below."""
    crop = face_crop(oval((500, 400), 300, 220), 512, (1000, 900))
    points = crop.points(oval((500, 400), 300, 220))
    low, high = points.min(axis=0), points.max(axis=0)
    assert (high - low)[1] / 512 == pytest.approx(0.7, abs=0.01)
    assert (low + high)[0] / 2 == pytest.approx(256, abs=0.5)
    above, below = low[1] / 512, 1 - high[1] / 512
    assert 0.15 < above < 0.20
    assert 0.10 < below < above


def test_face_crop_of_a_wide_face_and_at_the_edge():
    """A head that is wider than high still fits; a square beyond the photo is no error."""
    points = face_crop(oval((60, 60), 100, 140), 256, (400, 400))
    inside = points.points(oval((60, 60), 100, 140))
    assert inside.min() > 0.1 * 256
    assert inside.max() < 0.9 * 256
    assert (points.origin < 0).all()


def test_face_outside_the_photo():
    """A face mostly cut off cannot be reconstructed."""
    with pytest.raises(FaceError, match="outside the photo"):
        face_crop(oval((-50, 100), 200, 150), 512, (400, 400))


def test_an_array_that_is_no_picture_is_refused() -> None:
    """Values that are no numbers would end up in every map."""
    hole = np.full((40, 40, 3), 0.5)
    hole[3, 4] = np.nan
    with pytest.raises(PhotoError, match="not finite numbers"):
        Photo.of(hole)
    with pytest.raises(PhotoError, match="shape"):
        Photo.of(np.zeros((0, 0, 3)))
