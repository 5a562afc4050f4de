"""`unlit relight` from the command line to the file."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from saved_head import SIZE, Saved
from unlit import cli
from unlit.color import encode_srgb
from unlit.output.images import exr
from unlit.photo.photo import read_photo
from unlit.relighting import composite
from unlit.relighting.person import Person
from unlit.storage.pictures import read_picture


def run(*arguments: object) -> int:
    try:
        return cli.main(["relight", *map(str, arguments)])
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.mark.parametrize("how", [("--fast",), ("--samples", 16)])
def test_sun_from_the_left_lights_the_left(saved: Saved, tmp_path: Path, how: tuple) -> None:
    """In the written picture, with either renderer; turned by 120 degrees it lights the right."""
    means = []
    for turn in (0, 120):
        out = tmp_path / f"{turn}.png"
        assert run(saved.result, "--light", "sun:-60,10", "--rotate", turn, "-o", out, *how) == 0
        picture = np.asarray(Image.open(out)).astype(float)
        assert picture.shape == (SIZE, SIZE, 3)
        assert picture[saved.face.face.mask == 0].max() == 0
        means.append((picture[:, : SIZE // 2].mean(), picture[:, SIZE // 2 :].mean()))
    (left, right), (other_left, other_right) = means
    assert left > 2 * right
    assert other_right > 2 * other_left


def test_brightness_and_files(saved: Saved, tmp_path: Path) -> None:
    """A stop doubles linear values; PNG is the sRGB of EXR; the light's file may be in any unit."""
    sky = np.random.default_rng(3).random((16, 32, 3)).astype(np.float32) * 700
    (tmp_path / "sky.exr").write_bytes(exr(sky))
    found = {}
    for ev, name in ((0, "a.exr"), (1, "b.exr"), (-1, "c.png")):
        out = tmp_path / name
        light = tmp_path / "sky.exr"
        assert run(saved.result, "--light", light, "--brightness", ev, "--fast", "-o", out) == 0
        if name.endswith("exr"):
            found[name] = read_picture(out)
    np.testing.assert_allclose(found["b.exr"], 2 * found["a.exr"], rtol=1e-5)
    shown = np.asarray(Image.open(tmp_path / "c.png"))
    wanted = 255 * np.clip(encode_srgb(found["a.exr"] / 2), 0, 1)
    assert np.abs(shown - wanted).max() <= 0.51
    assert 0.05 < found["a.exr"][saved.face.face.mask > 0.5].mean() < 1


def _places(saved: Saved, photo: np.ndarray) -> np.ndarray:
    """Where each pixel of the photo lies in the crop, by the crop's definition."""
    ys, xs = np.mgrid[: photo.shape[0], : photo.shape[1]] + 0.5
    (scale, _, x0), (_, _, y0) = saved.face.photo.crop.matrix
    return np.array([ys * scale + y0 - 0.5, xs * scale + x0 - 0.5])


@pytest.mark.parametrize("ending", ["png", "exr"])
def test_over_photo(
    saved: Saved, tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside the person the photo to the bit; past the fading rim the relit face in place."""
    photo = read_photo(saved.photo).pixels
    place = _places(saved, photo)
    middle = saved.face.face.camera.width / 2
    alpha = (np.hypot(place[0] - middle, place[1] - middle) < 0.6 * SIZE).astype(np.float32)
    square = saved.face.photo.crop
    shares = np.zeros((SIZE, SIZE), np.float32)
    person = Person(alpha, np.ones_like(alpha), square, 2.0, shares, shares)
    monkeypatch.setattr(composite, "find_person", lambda *_: person)
    plain, over = tmp_path / "plain.exr", tmp_path / f"over.{ending}"
    order = (saved.result, "--light", "side", "--fast")
    assert run(*order, "-o", plain) == 0
    assert run(*order, "--over-photo", saved.photo, "-o", over) == 0
    original = np.asarray(Image.open(saved.photo)) if ending == "png" else photo
    picture = np.asarray(Image.open(over)) if ending == "png" else read_picture(over)
    assert picture.shape == original.shape
    reach = ndimage.maximum_filter(saved.face.face.mask, 3) > 0
    outside = ndimage.map_coordinates(reach, place, order=0, cval=False) == 0
    outside &= ndimage.maximum_filter(alpha, 25) == 0
    assert 0.2 < outside.mean() < 0.95
    np.testing.assert_array_equal(picture[outside], original[outside])
    beside = (alpha > 0) & (ndimage.map_coordinates(reach, place, order=0, cval=False) == 0)
    assert (picture[beside] != original[beside]).mean() > 0.8
    face = np.asarray(ndimage.binary_fill_holes(saved.face.face.mask > 0))
    deep = ndimage.distance_transform_edt(face) > 0.11 * np.sqrt(face.sum()) + 2  # past the fade
    full = (ndimage.minimum_filter(saved.face.face.mask, 3) == 1) & deep
    inside = ndimage.map_coordinates(full, place, order=0, cval=False) == 1
    relit = read_picture(plain)
    channels = [ndimage.map_coordinates(relit[..., c], place, order=1) for c in range(3)]
    wanted = np.stack(channels, axis=-1)[inside]
    if ending == "png":
        wanted = 255 * np.clip(encode_srgb(wanted), 0, 1)
    assert np.abs(picture[inside] - wanted).mean() < 0.02 * wanted.mean()


def test_background_and_passes(saved: Saved, tmp_path: Path, capsys: Any) -> None:
    """A colour behind the person, as JPEG; passes alone, and beside a picture."""
    order = (saved.result, "--light", "side", "--fast", "--over-photo", saved.photo)
    grey = tmp_path / "grey.jpg"
    assert run(*order, "--background", "#00ff00", "-o", grey) == 0
    picture = np.asarray(Image.open(grey)).astype(int)
    assert picture.shape == np.asarray(Image.open(saved.photo)).shape
    assert (np.abs(picture - (0, 255, 0)).max(axis=-1) < 30).mean() > 0.1
    passes = tmp_path / "passes.exr"
    assert run(saved.result, "--light", "side", "--passes", passes) == 0
    assert passes.stat().st_size > 10_000
    capsys.readouterr()
    both = (*order, "--passes", tmp_path / "p.exr", "-o", tmp_path / "o.png")
    assert run(*both) == 0
    assert capsys.readouterr().out.split() == [str(both[-1]), str(both[-3])]


def test_numbered_pictures(saved: Saved, tmp_path: Path) -> None:
    """A sweep as pictures: names count from 1, and each is a frame of it."""
    out = tmp_path / "out_%03d.png"
    order = (saved.result, "--light", "sun:0,10", "--fast", "--frames", "4")
    assert run(*order, "-o", out) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"out_00{k}.png" for k in (1, 2, 3, 4)]
    frames = [np.asarray(Image.open(tmp_path / name)).astype(float) for name in names]
    sides = [(f[:, : SIZE // 2].mean(), f[:, SIZE // 2 :].mean()) for f in frames]
    assert sides[1][1] > 2 * sides[1][0]
    assert sides[3][0] > 2 * sides[3][1]


def test_a_sequence_spares_the_photo(saved: Saved, tmp_path: Path, capsys: Any) -> None:
    """Also where one of its names is the photo's; and a folder in its place is told at once."""
    photo = tmp_path / "photo_0001.png"
    photo.write_bytes(saved.photo.read_bytes())
    order = (saved.result, "--light", "flash", "--fast", "--frames", "2", "--over-photo", photo)
    assert run(*order, "-o", tmp_path / "photo_%04d.png") == 2
    assert "photo_0001.png: is an input" in capsys.readouterr().err
    assert photo.read_bytes() == saved.photo.read_bytes()
    (tmp_path / "out_0002.png").mkdir()
    assert run(*order, "-o", tmp_path / "out_%04d.png") == 1
    assert "out_0002.png: a folder" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out_0002.png", photo.name]


def test_another_photo_is_refused(saved: Saved, tmp_path: Path, capsys: Any) -> None:
    """Another picture of the same size, and the same picture at another size; nothing written."""
    other = tmp_path / "other.png"
    pixels = np.asarray(Image.open(saved.photo))
    for changed in (pixels[::-1], np.kron(pixels, np.ones((2, 2, 1), np.uint8))):
        Image.fromarray(np.ascontiguousarray(changed)).save(other)
        order = (saved.result, "--light", "flash", "--fast", "-o", tmp_path / "out.png")
        assert run(*order, "--over-photo", other) == 1
        message = capsys.readouterr().err
        assert "other.png: not the picture that this result was made from" in message
        assert message.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["other.png"]


@pytest.mark.parametrize("motion", [(), ("--turntable", "20")])
def test_video(saved: Saved, tmp_path: Path, motion: tuple) -> None:
    """A light that turns brightens one side after the other; a head that turns moves its nose."""
    out = tmp_path / "turn.gif"
    order = (saved.result, "--light", "sun:0,10", "--fast", "--frames", "4", "--fps", "10")
    assert run(*order, *motion, "-o", out) == 0
    with Image.open(out) as film:
        assert film.n_frames == 4  # type: ignore[attr-defined]
        assert film.info["duration"] == 100
        frames = []
        for number in range(4):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB")).astype(float))
    sides = [(f[:, : SIZE // 2].mean(), f[:, SIZE // 2 :].mean()) for f in frames]
    if motion:
        assert np.abs(frames[0] - frames[2]).mean() < 1  # 0 degrees twice
        assert np.abs(frames[1] - frames[3]).mean() > 5
    else:
        assert sides[1][1] > 2 * sides[1][0]  # from the right
        assert sides[3][0] > 2 * sides[3][1]  # from the left
        assert sum(sides[2]) < 0.1 * sum(sides[0])  # from behind


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (("-o", "a.tga"), 2, "give a .png, .jpg, .exr, .mp4 or .gif file"),
        (("-o", "a_%04d.mp4"), 2, "give a .png, .jpg, .exr, .mp4 or .gif file"),
        (("-o", "a_%04d.png", "--fps", "9"), 2, "fps has no use with numbered pictures"),
        (("-o", "a_%04d_%04d.png"), 2, "one number, right before the ending"),
        (("-o", "%04d_a.png"), 2, "one number, right before the ending"),
        (("-o", "50%dim.png", "--frames", "3"), 2, "frames makes a video"),
        (("-o", "o.exr", "--passes", "./o.exr"), 2, "picture and passes are two files"),
        (("--passes", "o.exr", "--samples", "9"), 2, "samples has no use with passes alone"),
        (
            ("--passes", "o.exr", "--over-photo", "p.png", "--background", "navy"),
            2,
            "background has no use with passes alone",
        ),
        (("-o", "a.png", "--background", "navy"), 2, "a background needs over_photo"),
        (
            ("-o", "a.png", "--over-photo", "p.png", "--background", "moon"),
            2,
            "moon: no such background",
        ),
        (("--passes", "a.png"), 2, "a.png: passes are an .exr file"),
        (("-o", "a.gif", "--passes", "a.exr"), 2, "passes are of one light"),
        ((), 2, "nothing to write: give a file, or passes"),
        (
            ("-o", "a.png", "--rotate", "sweep"),
            2,
            "a sweep makes a video",
        ),
        (("-o", "a.exr", "--frames", "9"), 2, "frames makes a video"),
        (("-o", "a.gif", "--rotate", "30"), 2, "use a sweep"),
        (("-o", "a.gif", "--turntable", "--over-photo", "p.png"), 2, "do not go together"),
        (("-o", "a.gif", "--turntable", "400"), 2, "turntable 400: choose 1 to 360"),
        (("-o", "a.gif", "--frames", "1"), 2, "frames 1: choose 2 to"),
        (
            ("-o", "a.png", "--brightness", "nan"),
            2,
            "to 20 (option --brightness)",
        ),
        (("-o", "a.png", "--fast", "--samples", "9"), 2, "samples has no use with fast"),
        (("-o", "a.png", "--light", "moon"), 2, "moon: no such light"),
        (("-o", "a.png", "--light", "no.hdr"), 1, "no.hdr: cannot be read"),
        (("-o", "a.png", "--light", "cut.hdr"), 1, "cut.hdr: no whole picture"),
        (("-o", "a.png", "--light", "huge.hdr"), 1, "huge.hdr: 80000 x 40000 pixels; at most"),
        (
            (
                "-o",
                "nowhere/a.png",
            ),
            1,
            "nowhere: no such folder",
        ),
        (("-o", "a.png", "--over-photo", "p.png"), 1, "p.png: no such file"),
    ],
)
def test_mistakes(
    saved: Saved,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Any,
    arguments: tuple[str, ...],
    code: int,
    reason: str,
) -> None:
    """One line, before anything is rendered, and no file."""
    monkeypatch.chdir(tmp_path)
    Path("cut.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n")
    Path("huge.hdr").write_bytes(b"#?RADIANCE\n\n-Y 40000 +X 80000\n")
    light = () if "--light" in arguments else ("--light", "flash")
    assert run(saved.result, *light, *arguments) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert reason in said.err
    assert said.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.hdr", "huge.hdr"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for one process")
def test_interrupted(saved: Saved, tmp_path: Path) -> None:
    """Ctrl-C in the middle of a video: code 130, no traceback, no file."""
    order = ["--light", "uniform", "--samples", "4000", "-o", str(tmp_path / "turn.gif")]
    process = subprocess.Popen(
        [sys.executable, "-m", "unlit", "relight", str(saved.result), *order],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "preparing\n"
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    rest = process.communicate(timeout=120)[1]
    assert process.returncode == 130
    assert "interrupted" in rest.splitlines()[-1]
    assert "Traceback" not in rest
    assert list(tmp_path.iterdir()) == []
