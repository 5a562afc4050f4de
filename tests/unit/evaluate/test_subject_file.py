"""subject.toml: what it makes of every kind of map, and one line for every mistake."""

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import plates
from unlit.errors import PictureError, SubjectError
from unlit.evaluate.scan import Scan
from unlit.evaluate.subject_file import files_of
from unlit.evaluate.subject_mesh import read_subject
from unlit.scene.light import uniform

SIZE = 64


def read(place: Path, text: str = plates.MINIMAL) -> Scan:
    return read_subject(plates.folder(place, text), SIZE)


def middles(image: np.ndarray) -> np.ndarray:
    """The colours in the middles of the plate's quarters, (2, 2, ...), top left first."""
    return image[20:45:24, 20:45:24]


def normal_map(path: Path, normal: tuple[float, float, float]) -> None:
    value = np.rint(255 * (np.array(normal) / 2 + 0.5)).astype(np.uint8)
    Image.fromarray(np.broadcast_to(value, (8, 8, 3)).copy()).save(path)


def test_only_a_mesh_and_its_albedo(tmp_path: Path) -> None:
    """The albedo's quarters where they belong; plain defaults for the rest; the true geometry."""
    scan = read(tmp_path)
    truth = scan.truth
    assert middles(truth.diffuse_albedo) == pytest.approx(
        plates.quarters(tmp_path / "albedo.png"), abs=1e-3
    )
    assert middles(truth.specular_albedo) == pytest.approx(1)
    assert middles(truth.normal) == pytest.approx(np.broadcast_to((0.0, 0.0, 1.0), (2, 2, 3)))
    assert middles(truth.position)[..., 2] == pytest.approx(-50, abs=1e-3)
    # 20 cm at 50 cm in a field of 24 degrees: 0.94 of the film.
    assert truth.seen.mean() == pytest.approx((10 / 50 / np.tan(np.radians(12))) ** 2, abs=0.03)


def test_photograph_of_a_matt_plate(tmp_path: Path) -> None:
    """Under a light of 1 from everywhere a matt plate shows its albedo."""
    text = plates.MINIMAL + "specular_albedo = { value = 0 }\n"
    image = read(tmp_path, text).photograph(uniform(), 64, 0)
    assert middles(image) == pytest.approx(plates.quarters(tmp_path / "albedo.png"), abs=0.02)


@pytest.mark.parametrize(
    ("name", "axis", "up"),
    [
        ("plate.obj", "", True),
        ("plate.obj", 'v_axis = "down"\n', False),
        ("plate.glb", "", False),
        ("plate.glb", 'v_axis = "up"\n', True),
    ],
)
def test_v_axis(tmp_path: Path, name: str, axis: str, up: bool) -> None:
    """By the format's convention, or as said: a wrong one puts the lips on the forehead."""
    text = plates.MINIMAL.replace("plate.obj", name).replace(
        "diffuse_albedo", axis + "diffuse_albedo"
    )
    file = plates.folder(tmp_path, text)
    (tmp_path / "plate.glb").write_bytes(plates.glb())
    seen = middles(read_subject(file, SIZE).truth.diffuse_albedo)
    colours = plates.quarters(tmp_path / "albedo.png")
    assert seen == pytest.approx(colours if up else colours[::-1], abs=1e-3)


def test_every_kind_of_map(tmp_path: Path) -> None:
    """Encodings, scales and values, a bent normal, a plate lifted by its displacement."""
    Image.fromarray(np.full((8, 8), 128, np.uint8)).save(tmp_path / "grey.png")
    normal_map(tmp_path / "normal.png", (0.6, 0.0, 0.8))
    text = plates.MINIMAL + (
        'specular_albedo = { file = "grey.png", encoding = "linear", scale = 2.0 }\n'
        "roughness = { value = 0.4 }\n"
        'normal = { file = "normal.png", space = "tangent" }\n'
        'displacement = { file = "grey.png", encoding = "linear", scale = 4.0, middle = 0.0 }\n'
    )
    scan = read(tmp_path, text)
    truth = scan.truth
    assert middles(truth.specular_albedo) == pytest.approx(2 * 128 / 255, abs=1e-3)
    assert middles(truth.normal) == pytest.approx(
        np.broadcast_to((0.6, 0.0, 0.8), (2, 2, 3)), abs=0.01
    )
    assert middles(truth.position)[..., 2] == pytest.approx(-50 + 4 * 128 / 255, abs=1e-2)
    assert scan.parts[0].roughness == pytest.approx(0.4)
    assert len(scan.parts[0].triangles) == 2 * 16


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ('space = "tangent"', (0.0, 0.6, 0.8)),
        ('space = "tangent", green = "down"', (0.0, -0.6, 0.8)),
        ('space = "object"', (0.0, 0.6, 0.8)),
    ],
)
def test_normal_maps(tmp_path: Path, fields: str, expected: tuple[float, ...]) -> None:
    """The green channel's two conventions, and object space."""
    normal_map(tmp_path / "normal.png", (0.0, 0.6, 0.8))
    scan = read(tmp_path, plates.MINIMAL + f'normal = {{ file = "normal.png", {fields} }}\n')
    assert middles(scan.truth.normal) == pytest.approx(
        np.broadcast_to(expected, (2, 2, 3)), abs=0.01
    )


def test_pose_and_units(tmp_path: Path) -> None:
    """A plate of 0.2 m that lies on its back is turned up, and its object normals with it."""
    normal_map(tmp_path / "normal.png", (0.0, 1.0, 0.0))
    lying = "[[0.01, 0, 0, 0], [0, 0, 0.01, 0], [0, -0.01, 0, 0], [0, 0, 0, 1]]"
    text = plates.MINIMAL.replace(
        'units = "cm"', f'units = "m"\nobject_to_world = {lying}'
    ).replace("[0, 0, 1, 50]", "[0, 0, 1, 0.5]")
    text += 'normal = { file = "normal.png", space = "object" }\n'
    file = plates.folder(tmp_path, text)
    flat = plates.OBJ.replace("-10 -10 0", "-10 0 -10").replace("v 10 -10 0", "v 10 0 -10")
    flat = flat.replace("v 10 10 0", "v 10 0 10").replace("v -10 10 0", "v -10 0 10")
    (tmp_path / "plate.obj").write_text(flat.replace("f 1/1 2/2 3/3 -1/-1", "f 1/1 2/2 3/3 4/4"))
    truth = read_subject(file, SIZE).truth
    assert middles(truth.position)[..., 2] == pytest.approx(-50, abs=1e-3)
    # World = (x, z, -y): the object's +y points away from the camera.
    assert middles(truth.normal)[..., 2] == pytest.approx(-1, abs=0.01)


def test_two_meshes(tmp_path: Path) -> None:
    """Each keeps its own maps: a small eye before the plate."""
    text = plates.MINIMAL + (
        '[[mesh]]\nfile = "eye.obj"\ndiffuse_albedo = { value = [0.1, 0.2, 0.3] }\n'
    )
    (tmp_path / "eye.obj").write_text("v -3 -3 2\nv 3 -3 2\nv 0 4 2\nf 1 2 3\n")
    scan = read(tmp_path, text)
    assert scan.truth.diffuse_albedo[32, 32] == pytest.approx((0.1, 0.2, 0.3))
    assert middles(scan.truth.diffuse_albedo) == pytest.approx(
        plates.quarters(tmp_path / "albedo.png"), abs=1e-3
    )
    vertices, triangles = scan.mesh()
    assert len(triangles) == 3
    assert vertices[triangles[2]][:, 2] == pytest.approx(-48)
    assert {path.name for path in files_of(tmp_path)} >= {"subject.toml", "plate.obj", "eye.obj"}


def albedo(value: str) -> str:
    return without("diffuse") + f"diffuse_albedo = {{ value = {value} }}\n"


def without(line: str) -> str:
    return "".join(x + "\n" for x in plates.MINIMAL.splitlines() if not x.startswith(line))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("format = 1\nname =", "no valid TOML"),
        ("a = " + "[" * 100_000, "no valid TOML"),
        (plates.MINIMAL.replace("24.0", "1" + "0" * 400), r"camera\.fov_x: Number out of range"),
        (albedo('["a", 0, 0]'), r"diffuse_albedo\.value.*: Expected "),
        (albedo("[nan, 0, 0]"), r"diffuse_albedo\.value.*: Expected "),
        (albedo("[[0], 0, 0]"), r"diffuse_albedo\.value.*: Expected "),
        (albedo("[true, 0, 0]"), r"diffuse_albedo\.value.*: Expected "),
        (albedo("[0, 0]"), r"diffuse_albedo\.value.*: Expected "),
        (albedo("0.5"), r"diffuse_albedo\.value.*: Expected "),
        (plates.MINIMAL.replace("format = 1", "format = 2"), r"format: Invalid enum value 2"),
        (without("name"), "name: is missing"),
        (plates.MINIMAL.replace('"cm"', '"inch"'), "units: Invalid enum value 'inch'"),
        (plates.MINIMAL.replace("units", "unit"), "unit: is not a field"),
        ("frontal = true\n" + plates.MINIMAL, "camera: give a"),
        (plates.MINIMAL.replace("24.0", "0"), r"camera\.fov_x: Expected `float` >= 0.1"),
        (plates.MINIMAL.replace("fov_x", "focal = 9\nfov_x"), r"camera: give either"),
        (plates.MINIMAL.replace("[0, 0, 0, 1]", "[0, 0, 50, 1]"), r"camera\.camera_to_world: must"),
        (plates.MINIMAL.replace("[1, 0, 0, 0]", "[-1, 0, 0, 0]"), "camera_to_world mirrors"),
        (plates.MINIMAL.replace('"plate.obj"', '"plat.obj"'), r"mesh\[0\]\.file: there is no"),
        (without("diffuse"), r"mesh\[0\]\.diffuse_albedo: is missing"),
        (
            plates.MINIMAL.replace("encoding", "encodng"),
            r"diffuse_albedo\.encodng: is not a field",
        ),
        (
            plates.MINIMAL.replace('"srgb"', '"gamma"'),
            r"diffuse_albedo\.encoding: Invalid enum value 'gamma'",
        ),
        (plates.MINIMAL + "gloss = { value = 1 }\n", r"mesh\[0\]\.gloss: is not a field here"),
        (
            plates.MINIMAL + "roughness = { value = 7 }\n",
            r"roughness\.value: Expected `float` <",
        ),
        (plates.MINIMAL + 'roughness = "rough"\n', r"roughness: Expected `object"),
        (plates.MINIMAL + "normal = {}\n", r"normal\.file: is missing"),
        (plates.MINIMAL.replace("[[mesh]]", "[mesh]"), "mesh: Expected `array`"),
        (plates.MINIMAL + 'v_axis = "left"\n', r"mesh\[0\]\.v_axis: Invalid enum value 'left'"),
    ],
)
def test_mistakes(tmp_path: Path, text: str, reason: str) -> None:
    """One line that names the file and the field."""
    file = plates.folder(tmp_path, text)
    with pytest.raises(SubjectError, match=reason) as caught:
        read_subject(file, SIZE)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_mistakes_are_found_by_line(tmp_path: Path) -> None:
    """In the second mesh, too."""
    second = plates.MINIMAL[plates.MINIMAL.index("[[mesh]]") :]
    text = plates.MINIMAL + "\n" + second + "gloss = 1\n"
    file = plates.folder(tmp_path, text)
    line = text.splitlines().index("gloss = 1") + 1
    with pytest.raises(SubjectError, match=rf", line {line}: mesh\[1\]\.gloss: is not a field"):
        read_subject(file, SIZE)


def test_broken_pictures(tmp_path: Path) -> None:
    """No picture, a cut picture, one too large to be read."""
    file = plates.folder(tmp_path)
    picture = tmp_path / "albedo.png"
    whole = picture.read_bytes()
    for content in (b"no picture", whole[: len(whole) // 2]):
        picture.write_bytes(content)
        with pytest.raises(PictureError, match=r"albedo\.png"):
            read_subject(file, SIZE)
    Image.new("1", (20000, 2)).save(picture)
    with pytest.raises(PictureError, match="at most 16384"):
        read_subject(file, SIZE)


@pytest.mark.parametrize(("width", "height"), [(14000, 14000), (10000, 13500)])
def test_pictures_of_too_many_pixels(tmp_path: Path, width: int, height: int) -> None:
    """Beyond Pillow's own limit and between its warning and that: refused by their header."""
    file = plates.folder(tmp_path)
    picture = tmp_path / "albedo.png"
    content = picture.read_bytes()
    header = content[12:16] + struct.pack(">II", width, height) + content[24:29]
    changed = content[:12] + header + struct.pack(">I", zlib.crc32(header)) + content[33:]
    picture.write_bytes(changed)
    with warnings.catch_warnings(), pytest.raises(PictureError, match="at most 134 million"):
        warnings.simplefilter("error")
        read_subject(file, SIZE)


def test_maps_need_texture_coordinates(tmp_path: Path) -> None:
    """A mesh without them cannot carry a picture."""
    file = plates.folder(tmp_path)
    (tmp_path / "plate.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SubjectError, match="no texture coordinates"):
        read_subject(file, SIZE)


def test_no_face_from_the_front(tmp_path: Path) -> None:
    """A subject that shows no face to a frontal camera: the likely causes are named."""
    text = without("width").replace("[camera]", "frontal = true").replace("fov_x = 24.0\n", "")
    text = "".join(x + "\n" for x in text.splitlines() if not x.startswith("camera_to"))
    with pytest.raises(SubjectError, match="no face found from the front; check object_to_world"):
        read(tmp_path, text)
