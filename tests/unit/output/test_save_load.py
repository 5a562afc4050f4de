"""What is saved is loaded again to the bit; a broken folder is named, never trusted."""

import dataclasses
import json
import re
import shutil
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from changed import changed
from small_head import save_quickly
from unlit.errors import OutputError
from unlit.face.conditions import Shadow
from unlit.face.head import Motion
from unlit.machine.runtime import mitsuba
from unlit.output.load import load
from unlit.output.save import FILES, needed_bytes, save
from unlit.storage.folder import CHECKPOINT

mi = mitsuba()

pytestmark = pytest.mark.usefixtures("no_relight")


@pytest.fixture(scope="module")
def saved(face, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "result"
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(face, folder, log="said\n")
    return folder


@pytest.fixture
def folder(saved, tmp_path) -> Path:
    """A copy of the saved result that a test may break."""
    return Path(shutil.copytree(saved, tmp_path / "result"))


def assert_same(a, b) -> None:
    """Equal type, shape and bits."""
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    else:
        assert a == b
        assert type(a) is type(b)


def test_round_trip_is_exact(face, folder):
    """Every field, including the camera's floats and the crop's matrix."""
    assert_same(load(folder), face)


def test_saving_tells_how_far_it_is(face, tmp_path):
    """Each file is a step; before them comes the atlas."""
    told = []
    save(face, tmp_path / "a", progress=lambda *step: told.append(step))
    assert told[0] == ("baking the atlas", 0, 2)
    assert {what for what, *_ in told[1:-1]} == {f"writing {name}" for name in FILES}
    assert [done for _, done, _ in told[1:]] == [*range(1, len(FILES) + 2)]
    assert told[-1] == ("done", len(FILES) + 1, len(FILES) + 1)


@pytest.mark.parametrize("sun", [None, np.array([0.6, 0.8, 0], np.float32)])
def test_a_shadow_with_its_sun_or_without(face, tmp_path, sun):
    rng = np.random.default_rng(0)
    shape = face.face.mask.shape
    visibility, trust = rng.random((2, *shape), np.float32)
    shadow = Shadow(visibility, rng.random((*shape, 3), np.float32), trust, sun)
    shadowed = changed(face, {"conditions.shadow": shadow})
    save(shadowed, tmp_path / "a")
    assert_same(load(tmp_path / "a"), shadowed)
    save(face, tmp_path / "b")
    assert load(tmp_path / "b").conditions.shadow is None


def test_what_moves_the_head(face, tmp_path):
    """It comes back; names that are not as many as the units are told."""
    random = np.random.default_rng(1)
    motion = Motion(
        ("jawOpen", "eyeBlinkLeft"),
        np.array([0, 0, 1], np.int32),
        np.array([2, 3, 2], np.int32),
        random.random((3, 3), np.float32),
        np.array([0.25, 0], np.float32),
        np.eye(3)[[1, 2, 0]],
        random.random(3),
    )
    save(changed(face, {"head.motion": motion}), tmp_path / "a")
    again = load(tmp_path / "a").head.motion
    assert again is not None and again.names == motion.names
    for name in ("unit", "vertex", "displacement", "expression", "rotation", "translation"):
        assert_same(getattr(again, name), getattr(motion, name))
    assert load_without(tmp_path / "a", "eyeBlinkLeft").startswith("head.units has 1 names")


def load_without(folder, unit):
    """What loading says when a unit's name is missing."""
    path = folder / "reconstruction.toml"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if line.strip() != f'"{unit}",'))
    with pytest.raises(OutputError) as found:
        load(folder)
    return str(found.value).split(": ", 1)[1]


def test_the_lights_colour_and_the_gain(face, tmp_path):
    """They come back, and the environment map has the colour."""
    color, gain = np.array([1, 0.41726586, 0.1], np.float32), 1.7000000000000002
    places = {"light.color": color, "conditions.light_color": color, "gain": gain}
    save(changed(face, places), tmp_path / "a")
    again = load(tmp_path / "a")
    assert_same(again.light.color, color)
    assert_same(again.conditions.light_color, color)
    assert again.gain == gain
    read = mi.Bitmap(str(tmp_path / "a" / "environment.exr"))
    np.testing.assert_allclose(np.array(read), face.light.rasterize()[..., None] * color)


def test_a_checkpoint_is_not_needed_any_more(face, folder):
    """It goes when the result is in place."""
    (folder / CHECKPOINT).write_bytes(b"state")
    save(face, folder)
    assert not (folder / CHECKPOINT).exists()


def test_the_folder_holds_what_it_says(folder):
    """All files of the list and no other, none empty."""
    table = tomllib.loads((folder / "reconstruction.toml").read_text())
    assert {path.name for path in folder.iterdir()} == set(FILES) == set(table["files"])
    assert all(path.stat().st_size for path in folder.iterdir())
    assert table["photo"] == "grüße.jpg"
    assert (folder / "reconstruction.log").read_text() == "said\n"


def test_the_same_result_gives_the_same_bytes(face, folder, tmp_path):
    """No time stamps: two runs can be compared file by file."""
    save(face, tmp_path / "second", log="said\n")
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes(), path.name


def test_exports_for_other_programs(face, folder):
    """The JSON files hold the camera matrix and every lobe to the bit of float32."""
    camera = json.loads((folder / "camera.json").read_text())
    assert camera["intrinsics"][0] == [face.face.camera.focal, 0, face.face.camera.cx]
    light = json.loads((folder / "light.json").read_text())
    np.testing.assert_array_equal(np.array(light["axis"], np.float32), face.light.axis)
    np.testing.assert_array_equal(np.array(light["sharpness"], np.float32), face.light.sharpness)


def test_needed_room_is_not_underestimated(folder):
    """Checked before a run: what a result takes must fit into it."""
    taken = sum(path.stat().st_size for path in folder.iterdir())
    assert taken < needed_bytes(32)


def test_metrics_say_what_the_steps_found(face, folder):
    """And nothing else: metrics.json is where the head's fit and the light's estimate are kept."""
    text = (folder / "metrics.json").read_text()
    metrics = json.loads(text)
    assert metrics["landmark_residual"] == face.head.landmark_residual
    assert metrics["head_model"] == "ball, CC0"
    assert metrics["unit_cd_m2"] == face.photo.white_luminance
    assert metrics["light_color"]["kelvin"] == face.conditions.light_estimate.kelvin
    assert metrics["losses"] == {"stage1": [[0, 1e-17], [2, 0.3]]}
    assert metrics["warnings"] == ["dark"]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("losses", {"stage1": [[0.5, 1.0]]}),
        ("losses", None),
        ("seconds", {"photo": "x"}),
        ("warnings", "dark"),
        ("landmark_residual", "x"),
        ("light_color", {"kelvin": 3000}),
    ],
)
def test_metrics_of_other_types_are_refused(folder, field, value):
    """One line with the file."""
    path = folder / "metrics.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {field: value}))
    with pytest.raises(OutputError, match=r"metrics\.json: not valid") as caught:
        load(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("format = 2", "format = 99", "format 99"),
        ("format = 2", "", "format: is missing"),
        ("photo = ", "picture = ", "line 7: picture: is not a field here"),
        ("photo = ", "rate_hld = 0.5\nphoto = ", "line 7: rate_hld: is not a field here"),
        (
            "focal = ",
            'focal = "x" #',
            "line 12: camera.focal: expected float, 1 or more, at most 1e+06",
        ),
        (
            "focal = ",
            "focal = -5 #",
            "line 12: camera.focal: expected float, 1 or more, at most 1e+06",
        ),
        ("focal = ", "focal = nan #", "line 12: camera.focal: expected float, 1 or more"),
        ("focal = ", "vocal = 2.0\nfocal = ", "line 12: camera.vocal: is not a field here"),
        ("cx = ", "cx = inf #", "line 13: camera.cx: expected float, -1e+06 or more"),
        ("[crop]", "[crops]", "crops: is not a field here"),
        ("resolution = 32", "resolution = 31", "31 pixels"),
        ("matrix = [", "matrix = [1, ", "crop.matrix[0]: Expected `array`"),
        ("gain = ", "gain = -", "light.gain: expected float, above 0, below 1e+38"),
        ("color = [", "colour = [", "light.colour: is not a field here"),
        ("color = [", "color = [0.5,", "light.color: Expected `array` of length 3"),
        ("[light]", "[lights]", "lights: is not a field here"),
        ("clip = ", "clips = ", "settings: clips: no such setting"),
        ("clip = ", 'clip = "x" #', "settings: clip='x': expected float"),
        ("[settings]", "[[[", "no valid TOML"),
    ],
)
def test_a_broken_toml_names_the_field(folder, old, new, named):
    """One line with the file and the field."""
    path = folder / "reconstruction.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(OutputError) as caught:
        load(folder)
    message = str(caught.value)
    assert re.search(r"reconstruction.toml(, line \d+)?: ", message)
    assert named in message
    assert "\n" not in message


def rewrite(folder: Path, name: str, array: np.ndarray | bytes | None) -> None:
    """Replace one member of reconstruction.npz, or drop it."""
    path = folder / "reconstruction.npz"
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    members.pop(f"{name}.npy")
    with zipfile.ZipFile(path, "w") as archive:
        for member, data in members.items():
            archive.writestr(member, data)
        if isinstance(array, bytes):
            archive.writestr(f"{name}.npy", array)
        elif array is not None:
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, array, allow_pickle=True)


class Bomb:
    """Ends the test run if it is ever unpickled."""

    def __reduce__(self):
        return (pytest.exit, ("a pickle was loaded",))


@pytest.mark.parametrize(
    ("name", "array", "named"),
    [
        ("mask", None, "mask is missing"),
        ("mask", np.zeros((32, 32)), "mask has type float64, expected float32"),
        ("mask", np.zeros((32, 31), "f4"), "mask has shape"),
        ("image", np.zeros((32, 32), "f4"), "image has shape"),
        ("uv", np.zeros((0, 2), "f4"), "uv has shape"),
        ("triangles", np.full((256, 3), 999, "i4"), "triangles points outside"),
        ("triangles", np.full((256, 3), -1, "i4"), "triangles points outside"),
        ("light_axis", np.zeros((11, 3), "f4"), "light_sharpness has shape"),
        ("fit_landmark_triangle", np.full(5, 999, "i4"), "fit_landmark_triangle points outside"),
        ("fit_landmark_triangle", np.full(5, -2, "i4"), "fit_landmark_triangle points outside"),
        ("fit_vertices", np.zeros((9, 3), "f4"), "fit_vertices has shape"),
        ("fit_vertices", None, "fit_vertices is missing"),
        ("landmarks", np.zeros((5, 3), "f4"), "landmarks has type float32"),
        ("render", np.array(Bomb(), dtype=object), "render has type object"),
        ("render", b"\x93NUMPY junk", "render is damaged"),
        ("render", b"", "render is damaged"),
    ],
)
def test_a_broken_array_is_named(folder, name, array, named):
    """Type and shape are checked, nothing is unpickled."""
    rewrite(folder, name, array)
    with pytest.raises(OutputError, match=r"reconstruction\.npz: ") as caught:
        load(folder)
    assert named in str(caught.value)


def test_a_huge_array_takes_no_memory(folder):
    """A header of a terabyte is refused before a byte is reserved for it."""
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (600000, 600000, 3), }\n"
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    rewrite(folder, "image", data)
    with pytest.raises(OutputError, match=r"image has shape .*; S is 1 to 4096"):
        load(folder)


def test_cut_off_and_missing_files(folder):
    """An npz cut in half, one that is no archive, none; metrics that are none."""
    path = folder / "reconstruction.npz"
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"text", b""):
        path.write_bytes(damaged)
        with pytest.raises(OutputError, match=r"reconstruction\.npz: .* damaged or cut off"):
            load(folder)
    path.unlink()
    with pytest.raises(OutputError, match=r"reconstruction\.npz: no such file"):
        load(folder)
    path.write_bytes(whole)
    (folder / "metrics.json").write_text("[1]")
    with pytest.raises(OutputError, match=r"metrics\.json: "):
        load(folder)


def test_a_folder_that_is_no_result(tmp_path):
    """Missing, a file, or somebody else's."""
    (tmp_path / "file").write_text("x")
    for name, reason in (
        (".", "reconstruction.toml is missing"),
        ("no", "no such"),
        ("file", "no such"),
    ):
        with pytest.raises(OutputError, match=reason):
            load(tmp_path / name)
