"""Morph targets on a person's own mesh, the neutral pose, eyes and corneas."""

import json
import os
import struct
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from khronos import issues_of
from moving_head import GAZE, IRIS, moving_head
from small_head import small_head
from unlit.color import encode_srgb
from unlit.errors import OutputError, SettingsError
from unlit.face.head import Motion
from unlit.face.reconstruction import Reconstruction
from unlit.head.contact import pieces
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.machine.runtime import mitsuba
from unlit.output.cornea import BULGE, FILM, cornea
from unlit.output.export import export, job_of
from unlit.output.eyes import Eye, eyes_of, looking
from unlit.output.geometry import welded
from unlit.output.gltf import _over, _piece, glb
from unlit.output.shapes import _clear, neutral, shapes
from unlit.perception.topology import BLENDSHAPE_NAMES, LEFT_LID_GAP, RIGHT_LID_GAP
from unlit.render.reference import path_trace
from unlit.scene.mesh import Mesh

#: Blender's pixels for one of ours, along a side.
FINER = 5
#: ARKit's names: those of the landmarker's scores, and the tongue's.
ARKIT = {*BLENDSHAPE_NAMES[1:], "tongueOut"}


def motion_of(r: Reconstruction) -> Motion:
    assert r.head.motion is not None
    return r.head.motion


@pytest.fixture(scope="module")
def r(head: HeadModel) -> Reconstruction:
    """A head that squints a little and has its mouth open."""
    return moving_head(head, {"eyeBlinkLeft": 0.2, "jawOpen": 0.3})


@pytest.fixture(scope="module")
def eyes(r: Reconstruction) -> tuple[Eye, ...]:
    return eyes_of(r)


@pytest.fixture(scope="module")
def moved(r: Reconstruction, eyes: tuple[Eye, ...]) -> dict[str, np.ndarray]:
    """In the model's frame."""
    found = shapes(looking(r, eyes), eyes)
    return {name: delta @ motion_of(r).rotation for name, delta in found.items()}


def local(r: Reconstruction) -> np.ndarray:
    motion = motion_of(r)
    return (r.face.mesh.vertices - motion.translation) @ motion.rotation


def test_all_of_arkit_and_left_is_the_persons_own(r, moved):
    """52 names; what is called left moves the side at +x of a face that looks along +z."""
    assert set(moved) == ARKIT
    x = local(r)[:, 0]
    sides = [name.removesuffix("Left") for name in moved if name.endswith("Left")]
    for name in set(sides) - {"jaw", "mouth"}:
        for side, sign in (("Left", 1), ("Right", -1)):
            amount = np.linalg.norm(moved[name + side], axis=1)
            assert (amount * x).sum() * sign > 0.4 * (amount * np.abs(x)).sum(), name + side
    # These move the whole: to the person's left.
    for name in ("jaw", "mouth"):
        assert moved[name + "Left"][:, 0].sum() > 0 > moved[name + "Right"][:, 0].sum()


def test_lower_teeth_go_with_the_jaw(head, r, moved):
    """As far as the chin, and the upper row not at all."""
    of_teeth = head.vertex_region == VERTEX_REGIONS.index("teeth")
    piece = pieces(head)
    rows = [piece == number for number in np.unique(piece[of_teeth])]
    upper, lower = sorted(rows, key=lambda row: -head.neutral[row, 1].mean())
    assert np.abs(moved["jawOpen"][upper]).max() == 0
    assert -4 < moved["jawOpen"][lower, 1].mean() < -1.5
    tongue = ~of_teeth & (piece == piece[np.abs(moved["tongueOut"]).sum(axis=1).argmax()])
    assert moved["tongueOut"][tongue, 2].max() > 1
    assert np.abs(moved["tongueOut"][~tongue]).max() < 1e-6


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_blink_shuts_this_persons_lids_in_front_of_the_eye(r, eyes, moved, side):
    """From where the photo has them, one a little over the other; on the way no lid gets deeper
    into the eye."""
    start, delta = local(r), moved["eyeBlink" + side]
    gap = LEFT_LID_GAP if side == "Left" else RIGHT_LID_GAP
    upper, lower = (list(rim) for rim in zip(*gap, strict=True))
    points = r.head.landmark_points.on(start + delta, r.face.mesh.triangles)
    opened = points[upper, 1] - points[lower, 1]
    assert opened.max() < 0.01 and opened.min() > -0.1
    eye = eyes[side == "Left"]
    centre = (eye.centre - motion_of(r).translation) @ motion_of(r).rotation
    lids = ~eye.vertices & (np.linalg.norm(delta, axis=1) > 0.05)
    outside = np.linalg.norm(start[lids] - centre, axis=1) > eye.radius
    for way in (0.25, 0.5, 0.75, 1.0):
        height = np.linalg.norm((start + way * delta)[lids] - centre, axis=1) - eye.radius
        assert height[outside].min() > -0.02


def test_eyes_turn_as_balls(r, eyes, moved):
    """Each about its middle; out is away from the nose, up is up; the other eye stays."""
    start = local(looking(r, eyes))
    for eye in eyes:
        side, outwards = ("Left", 1) if eye.left else ("Right", -1)
        ball = start[eye.vertices]
        front = ball[:, 2].argmax()
        for way, axis, sign in (("Out", 0, outwards), ("In", 0, -outwards), ("Up", 1, 1)):
            delta = moved[f"eyeLook{way}{side}"]
            assert delta[eye.vertices][front, axis] * sign > 0.2
            turned = ball + delta[eye.vertices]
            middle = (ball.min(axis=0) + ball.max(axis=0)) / 2
            np.testing.assert_allclose(
                np.linalg.norm(turned - middle, axis=1), eye.radius, atol=2e-3
            )
            other = eyes[not eye.left]
            assert np.abs(delta[other.vertices]).max() < 1e-6


def test_neutral_takes_pose_and_expression_off(head, r, eyes):
    """What is left is the model's neutral but for its lids; eyes look straight ahead."""
    plain, straight = neutral(looking(r, eyes), eyes)
    off = np.linalg.norm(plain.face.mesh.vertices - head.neutral, axis=1)
    skin = ~(eyes[0].vertices | eyes[1].vertices)
    assert np.percentile(off[skin], 90) < 1e-3 and off[skin].max() < 0.15
    for eye in straight:
        np.testing.assert_allclose(eye.axis, (0, 0, 1), atol=1e-6)
        ball = plain.face.mesh.vertices[eye.vertices]
        np.testing.assert_allclose(np.linalg.norm(ball - eye.centre, axis=1), eye.radius, atol=2e-3)
    with pytest.raises(OutputError, match="does not say how its head is posed"):
        neutral(small_head(32), ())


def test_eyes_are_found_in_the_photo(head):
    """Where they look to 5 degrees, and its iris to a tenth, whose radius is 6 pixels."""
    r = moving_head(head, {}, 256)
    for eye in eyes_of(r):
        cosine = eye.axis @ motion_of(r).rotation @ GAZE
        assert np.degrees(np.arccos(cosine)) < 5
        assert eye.rim == pytest.approx(IRIS, rel=0.1)
    assert [eye.left for eye in eyes_of(r)] == [False, True]
    assert eyes_of(small_head(32)) == ()


def test_lids_are_moved_out_of_an_eye_that_does_not_move():
    """Told by an argument, not by whether both arrays are one."""
    inside = np.array([[0.0, 0.0, 1.005], [0.0, 0.0, 1.4]])
    front = np.array([0.0, 0.0, 1.0])
    eye = Eye(True, np.zeros(2, bool), np.zeros(3), 1.0, front, 0.3)
    assert (_clear(inside, inside, eye, front) == inside).all()
    still = _clear(inside, inside.copy(), eye, front, still=True)
    assert (still == _clear(inside, inside, eye, front, still=True)).all()
    assert still[0, 2] > 1.01 and (still[1] == inside[1]).all()


def test_a_cornea_turns_about_the_eye_not_about_the_middle_of_what_is_seen(r, eyes):
    """Its points stay as far from the eye's centre, also of an eyeball cut in half."""
    eye = eyes[0]
    mesh = welded(looking(r, eyes))
    corner = mesh.vertex[mesh.triangles[:, 0]]
    front = (mesh.position[mesh.triangles].mean(axis=1) - eye.centre) @ eye.axis > 0
    turn = Rotation.from_euler("y", 20, degrees=True).as_matrix()
    delta = (mesh.position - eye.centre) @ turn.T + eye.centre - mesh.position
    ball = _piece(mesh, eye.vertices[corner] & front, {"turned": (delta, delta)})
    clear = cornea(eye, ball.position, ball.triangles)
    moves, _ = _over(ball, clear, eye.centre).targets["turned"]
    arm = clear.position - eye.centre
    assert np.allclose(arm + moves, arm @ turn.T, atol=1e-4)


def test_the_cornea_bulges_over_the_iris_and_joins_the_ball(r, eyes):
    """One surface without doubled points, before the ball; its normals are the surface's."""
    eye = eyes[0]
    mesh = welded(looking(r, eyes))
    ball = eye.vertices[mesh.vertex[mesh.triangles[:, 0]]]
    clear = cornea(eye, mesh.position, mesh.triangles[ball])
    arm = clear.position - eye.centre
    height = np.linalg.norm(arm, axis=1) - eye.radius
    angle = np.arccos(np.clip((arm / np.linalg.norm(arm, axis=1)[:, None]) @ eye.axis, -1, 1))
    assert height.min() == pytest.approx(FILM, abs=1e-6)
    assert height.max() == pytest.approx(FILM + BULGE, abs=1e-3)
    assert (np.abs(height[angle > 1.1 * eye.rim] - FILM) < 1e-6).all()
    assert len(np.unique(clear.position.round(6), axis=0)) == len(clear.position)
    a, b, c = (clear.position[clear.triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    mean = clear.normal[clear.triangles].mean(axis=1)
    assert ((flat * mean).sum(axis=1) > 0.99).all()


def contents(data: bytes) -> tuple[dict, bytes]:
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def sparse(document: dict, binary: bytes, number: int) -> np.ndarray:
    """The values of a sparse accessor, as glTF 2.0 has them."""
    accessor = document["accessors"][number]
    views = document["bufferViews"]

    def read(view: int, kind: str) -> np.ndarray:
        place = views[view]
        return np.frombuffer(binary[place["byteOffset"] :][: place["byteLength"]], kind)

    some = accessor["sparse"]
    out = np.zeros((accessor["count"], 3), np.float32)
    rows = read(some["indices"]["bufferView"], "<u2")
    out[rows] = read(some["values"]["bufferView"], "<f4").reshape(-1, 3)
    np.testing.assert_allclose(out.max(axis=0), accessor["max"], atol=1e-9)
    return out


def test_targets_in_the_file(r):
    """Named, at rest, and the units to 0.05 mm; nodes for what an animator takes hold of."""
    job = job_of(r, 512, "face")
    document, binary = contents(glb(job.reconstruction, job.atlas, job.eyes))
    nodes = {node["name"] for node in document["nodes"]}
    eyes = {f"{part}_{side}" for part in ("eye", "cornea") for side in ("left", "right")}
    assert nodes == {"head", "face", "mouth", "teeth", "photo camera"} | eyes
    meshes = {mesh["name"]: mesh for mesh in document["meshes"]}
    found = set()
    for mesh in meshes.values():
        names = mesh["extras"]["targetNames"]
        assert mesh["weights"] == [0] * len(names)
        assert len(mesh["primitives"][0]["targets"]) == len(names)
        found |= set(names)
    assert found == ARKIT
    looks = {f"eyeLook{way}Left" for way in ("Up", "Down", "In", "Out")}
    assert set(meshes["eye_left"]["extras"]["targetNames"]) == looks
    assert set(meshes["cornea_left"]["extras"]["targetNames"]) == looks
    jaw = shapes(job.reconstruction, job.eyes)["jawOpen"]
    target = meshes["face"]["primitives"][0]["targets"][
        meshes["face"]["extras"]["targetNames"].index("jawOpen")
    ]
    written = 100 * sparse(document, binary, target["POSITION"])
    assert written[:, 1].min() == pytest.approx(jaw[:, 1].min(), abs=1e-3)
    materials = {material["name"]: material for material in document["materials"]}
    assert materials["cornea"]["alphaMode"] == "BLEND"


def test_khronos_validates_it(r, tmp_path):
    """In both poses. Needs node and the npm package gltf-validator."""
    for pose in ("photo", "neutral"):
        folder = export(r, tmp_path / pose, tmp_path, ["glb"], 512, pose=pose)
        assert issues_of(folder / "face.glb") == [0, 0, 0, 0]


def test_blender_moves_it_and_renders_the_same_skin(head, tmp_path):
    """Shape keys of ARKit's names that move; skin within 30 dB of our path tracer's, one thread.

    Needs Blender's Python: the variable UNLIT_TEST_BLENDER, or the package bpy.
    """
    program = os.environ.get("UNLIT_TEST_BLENDER")
    if program is None or "python" not in Path(program).name:
        if find_spec("bpy") is None:
            pytest.skip("no Blender as a Python package: install bpy, or set UNLIT_TEST_BLENDER")
        program = sys.executable
    r = moving_head(head, {})
    folder = export(r, tmp_path / "out", tmp_path, ["glb"], 1024)
    document, _ = contents((folder / "face.glb").read_bytes())
    film, crop = (np.array(document["cameras"][0]["extras"][name]) for name in ("film", "crop"))
    width, height = np.rint(film * FINER).astype(int)
    picture = tmp_path / "picture.exr"
    script = Path(__file__).with_name("blender_reads_glb.py")
    files = [folder / "face.glb", folder / "environment_gltf.exr", picture]
    done = subprocess.run(
        [program, script, *map(str, [*files, width, height])],
        check=True,
        capture_output=True,
        timeout=600,
        text=True,
    )
    found = json.loads(done.stdout.strip().splitlines()[-1])
    assert set().union(*found["keys"].values()) == ARKIT
    assert found["travel"]["face"] > 0.03 and 0.015 < found["travel"]["teeth"] < 0.05
    theirs = np.array(mitsuba().Bitmap(str(picture)))[..., :3].astype(np.float32)
    x, y, wide, high = np.rint(crop * FINER).astype(int)
    theirs = theirs[y : y + high, x : x + wide].reshape(96, FINER, 96, FINER, 3).mean(axis=(1, 3))
    ours = path_trace(
        Mesh(r.face.mesh.vertices, r.face.mesh.triangles),
        r.face.camera,
        r.face.maps,
        r.light.rasterize(),
        128,
        bounces=3,
    )
    # Of the mask what is skin with its neighbours: eyes have corneas there, rims half a pixel.
    measured = (r.face.mask > 0) & (r.photo.regions.eyes < 0.5)
    skin: Any = ndimage.binary_erosion(measured, iterations=2)
    error = (encode_srgb(np.clip(ours, 0, 1)) - encode_srgb(np.clip(theirs, 0, 1)))[skin]
    print(-10 * np.log10((error**2).mean()), ours[skin].mean() / theirs[skin].mean())
    assert -10 * np.log10((error**2).mean()) > 30


def test_a_neutral_export(r, tmp_path: Path):
    """Upright and without a camera, in all its files; views of the photo are refused."""
    folder = export(r, tmp_path / "out", tmp_path, ["glb", "ply"], 512, pose="neutral")
    document, _ = contents((folder / "face.glb").read_bytes())
    assert "cameras" not in document
    assert 'pose = "neutral"' in (folder / "export.toml").read_text()
    names = [mesh["name"] for mesh in document["meshes"]]
    eyes = [names.index(f"eye_{side}") + 1 for side in ("right", "left")]
    right, left = (document["nodes"][number]["translation"] for number in eyes)
    assert left[0] - right[0] > 0.05 and abs(left[1] - right[1]) < 2e-3
    with pytest.raises(SettingsError, match="blender renders the photo's view"):
        export(r, tmp_path / "no", tmp_path, ["glb", "blender"], 512, pose="neutral")
    with pytest.raises(SettingsError, match="pose asleep: choose from photo, neutral"):
        export(r, tmp_path / "no", tmp_path, ["glb"], 512, pose="asleep")


def test_reflections_leave_the_iris(head):
    """A bright spot on the iris is not in the texture; what lids hide is iris and white, too."""
    r = moving_head(head, {"eyeBlinkLeft": 0.3, "eyeBlinkRight": 0.3}, 256)
    albedo, image = r.face.maps.diffuse_albedo, r.photo.image
    for first in (468, 473):
        x, y = r.photo.landmarks[first, :2].astype(int)
        albedo[y - 1 : y + 2, x : x + 2] = image[y - 1 : y + 2, x : x + 2] = 0.9
    job = job_of(r, 1024, "face")
    uv, mesh = job.atlas.mesh.uv, job.atlas.mesh
    for eye in job.eyes:
        corners = np.flatnonzero(eye.vertices[mesh.vertex])
        unit = (mesh.position[corners] - eye.centre) / eye.radius
        angle = np.arccos(np.clip(unit @ eye.axis, -1, 1))
        place = (uv[corners] * (1024, -1024) + (0, 1024)).astype(int).clip(0, 1023)
        colour = job.atlas.diffuse_albedo[place[:, 1], place[:, 0], 1]
        assert colour[angle < 0.8 * eye.rim].max() < 0.05
        white = colour[(angle > 1.3 * eye.rim) & (angle < 2.5)]
        assert white.min() > 0.4
