"""`unlit export`: the files it promises, in a folder of its own."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import KDTree

from small_head import CENTRE, save_quickly, small_head, with_outline
from unlit.cli import main
from unlit.cli.export import EXPORTS, LAYOUTS, MAPS, POSES, SCALPS
from unlit.color import encode_srgb
from unlit.errors import OutputError, SettingsError
from unlit.face.reconstruction import Reconstruction
from unlit.output import layout, scalp
from unlit.output.export import FORMATS, default_formats, export
from unlit.output.export import POSES as export_poses
from unlit.output.save import save
from unlit.output.textures import MAP_FILES


@pytest.fixture(scope="module")
def r() -> Reconstruction:
    return small_head(64)


@pytest.fixture(scope="module")
def everything(r, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("result")
    return export(r, folder / "export", folder, EXPORTS, 512)


def test_the_folder_holds_what_it_says(everything):
    """export.toml lists every file; the command's formats are the module's, by default too."""
    table = tomllib.loads((everything / "export.toml").read_text())
    assert {path.name for path in everything.iterdir()} == set(table["files"])
    assert all(path.stat().st_size for path in everything.iterdir())
    assert table["source"] == ".."
    assert (table["size"], table["layout"], table["scalp"]) == (512, "face", "skin")
    assert (*EXPORTS, "usd") == tuple(FORMATS)
    assert LAYOUTS == layout.LAYOUTS
    assert SCALPS == scalp.SCALPS
    assert default_formats("photo") == EXPORTS
    assert export_poses == POSES


def test_obj_with_materials(r, everything):
    """trimesh finds texture and parts through the MTL, in centimetres of the world frame."""
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(everything / "mesh.obj", split_object=False, group_material=True)
    parts = {g.visual.material.name: g for g in scene.geometry.values()}
    assert set(parts) == {"skin", "eyes"}
    assert parts["skin"].visual.material.image.size == (512, 512)
    vertices = np.concatenate([part.vertices for part in parts.values()])
    np.testing.assert_allclose(vertices.min(axis=0), r.face.mesh.vertices.min(axis=0), atol=1e-4)
    # The texture is the right way up: the skin at the front has the colour of the photo there.
    skin = parts["skin"]
    colours = np.asarray(skin.visual.material.image.convert("RGB")) / 255
    front = np.linalg.norm(skin.vertices - CENTRE - (0, -6, 7), axis=1).argmin()
    u, v = skin.visual.uv[front]
    x, y = r.face.camera.project(skin.vertices[front])
    seen = encode_srgb(r.face.maps.diffuse_albedo[int(y), int(x)])
    np.testing.assert_allclose(colours[int((1 - v) * 512), int(u * 512)], seen, atol=0.03)


def test_directx_turns_green_upside_down(r, tmp_path):
    """Only the green of the PNG normals changes."""
    for flag in (False, True):
        export(r, tmp_path / str(flag), tmp_path, ["obj"], 512, flag)
    name = "atlas_specular_normal.png"
    plain, turned = (np.asarray(Image.open(tmp_path / str(flag) / name)) for flag in (False, True))
    np.testing.assert_allclose(turned[..., 1], 255.0 - plain[..., 1], atol=1)
    np.testing.assert_array_equal(turned[..., ::2], plain[..., ::2])
    assert np.ptp(plain[..., 1]) > 5


def test_it_is_replaced_but_nothing_else_is(r, tmp_path):
    """A second export replaces the first; somebody else's files are refused."""
    for _ in range(2):
        export(r, tmp_path / "mine", tmp_path, ["ply"], 512)
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "mesh.ply").write_text("theirs")
    with pytest.raises(OutputError, match=r"theirs: holds mesh\.ply"):
        export(r, tmp_path / "theirs", tmp_path, ["ply"], 512)
    assert (tmp_path / "theirs" / "mesh.ply").read_text() == "theirs"


def test_a_smaller_export_leaves_none_of_the_larger_ones_files(r, tmp_path):
    """What only the old export.toml lists goes; unlisted files and odd names in the list stay."""
    folder = export(r, tmp_path / "export", tmp_path, ["obj"], 512)
    assert (folder / "mesh.mtl").is_file()
    outside = tmp_path / "outside.txt"
    kept = [outside, folder / "notes.txt", folder / ".hidden", folder / "kept" / "a.txt"]
    (folder / "kept").mkdir()
    for path in kept:
        path.write_text("mine")
    mark = folder / "export.toml"
    odd = ["../outside.txt", str(outside), ".hidden", "kept/a.txt", "kept", "..", "\\u0000"]
    listed = "".join(f'"{name}", ' for name in odd)
    mark.write_text(mark.read_text().replace("files = [", f"files = [{listed}"))
    assert set(odd) - {"\\u0000"} < set(tomllib.loads(mark.read_text())["files"])
    export(r, folder, tmp_path, ["ply"], 512)
    assert all(path.read_text() == "mine" for path in kept)
    files = set(tomllib.loads(mark.read_text())["files"])
    assert {path.name for path in folder.iterdir()} == files | {"notes.txt", ".hidden", "kept"}
    assert "mesh.mtl" not in files


@pytest.mark.parametrize(
    ("formats", "size", "named"),
    [(["fbx", "glb"], 512, "fbx: choose from glb"), ([], 512, "no format"), (["glb"], 64, "64")],
)
def test_wrong_wishes(r, tmp_path, formats, size, named):
    """One line that says what there is to choose from."""
    with pytest.raises(SettingsError, match=named):
        export(r, tmp_path / "out", tmp_path, formats, size)
    assert not (tmp_path / "out").exists()


def test_command(r, tmp_path, capsys):
    """`unlit export DIR` writes into DIR/export and prints its path; wrong wishes are code 2."""
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(r, tmp_path / "result")
    source = str(tmp_path / "result")
    assert main(["export", source, "--format", "ply", "--size", "512"]) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(tmp_path / "result" / "export")
    assert said.err.strip() == "baking the atlas"
    assert (tmp_path / "result" / "export" / "mesh.ply").is_file()
    assert main(["export", source, "--format", "fbx"]) == 2
    assert "fbx: choose from glb" in capsys.readouterr().err
    # Into the result itself: its own mesh.ply is not an export's, and stays.
    assert main(["export", source, "-o", source, "--format", "ply", "--size", "512"]) == 1
    assert "not a whole export" in capsys.readouterr().err


def test_only_maps(r, everything, tmp_path, capsys):
    """The named maps as they are in a whole export, and no other file; a wrong name is refused."""
    export(r, tmp_path / "maps", tmp_path, size=512, only_maps=("roughness", "confidence"))
    names = {"atlas_perceptual_roughness.png", "atlas_roughness.exr", "atlas_confidence.png"}
    assert {path.name for path in (tmp_path / "maps").iterdir()} == names | {"export.toml"}
    for name in names:
        assert (tmp_path / "maps" / name).read_bytes() == (everything / name).read_bytes()
    with pytest.raises(SettingsError, match="shading: choose from diffuse_albedo, "):
        export(r, tmp_path / "maps", tmp_path, only_maps=("shading",))
    assert tuple(MAP_FILES) == MAPS
    assert main(["export", "x", "--only-maps", "roughness", "--format", "ply"]) == 2
    assert "not allowed with" in capsys.readouterr().err


def test_usd(r, tmp_path):
    """Read back by Pixar's own library: metres, y up, textures bound to every face."""
    pytest.importorskip("pxr")
    Usd, UsdGeom, UsdShade = map(
        importlib.import_module, ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdShade")
    )
    folder = export(r, tmp_path / "usd", tmp_path, ["usd"], 512)
    stage = Usd.Stage.Open(str(folder / "face.usda"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    face = UsdGeom.Mesh(stage.GetPrimAtPath("/head/face"))
    points = np.array(face.GetPointsAttr().Get())
    assert np.ptp(points[:, 1]) == pytest.approx(np.ptp(r.face.mesh.vertices[:, 1]) / 100, rel=1e-4)
    assert len(face.GetFaceVertexCountsAttr().Get()) == len(r.face.mesh.triangles)
    material, _ = UsdShade.MaterialBindingAPI(face.GetPrim()).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    for name in ("diffuseColor", "roughness", "normal"):
        texture = surface.GetInput(name).GetConnectedSource()[0].GetPrim()
        file = UsdShade.Shader(texture).GetInput("file").Get().path
        assert (folder / file).is_file()
    assert {s.GetPrim().GetName() for s in UsdGeom.Subset.GetAllGeomSubsets(face)} == {
        "skin",
        "eyes",
    }


def test_the_blender_script_names_files_that_are_there(everything):
    """Without Blender: it compiles, and what it reads is written."""
    text = (everything / "blender.py").read_text()
    compile(text, "blender.py", "exec")
    files = set(re.findall(r'"(\w+\.(?:exr|obj|json))"', text))
    assert len(files) == 9
    assert all((everything / file).is_file() for file in files)
    assert json.loads((everything / "blender.json").read_text())["size"] == [64, 64]


def test_the_blender_script_shades_by_normals_or_by_displacement(everything):
    """Never by both; the EXR's millimetres are metres there, and 0 is the mesh."""
    text = (everything / "blender.py").read_text()
    assert re.search(r'^DETAIL = "normals"$', text, re.M)
    material = text.split("def face_material")[1].split("\ndef ")[0]
    either, other = material.split('if DETAIL == "normals":')[1].split("    else:")
    assert 'inputs["Normal"]' in either
    assert 'inputs["Normal"]' not in material.replace(either, "")
    assert 'output.inputs["Displacement"]' in other
    assert 'output.inputs["Displacement"]' not in material.replace(other, "")
    node = text.split("def displaced")[1].split("\ndef ")[0]
    assert 'node.space = "WORLD"' in node
    assert 'inputs["Midlevel"].default_value = 0.0' in node
    assert 'inputs["Scale"].default_value = MILLIMETRE' in node
    assert "global_scale=0.01" in text  # the file's centimetres are metres
    assert re.search(r"^MILLIMETRE = 0\.001$", text, re.M)


def test_blender_renders_the_same_face(r, everything):
    """In Blender's Cycles: 30 dB of our path tracer. Needs `blender` or the package bpy.

    The variable UNLIT_TEST_BLENDER may name a blender, or a Python that has bpy.
    """
    from unlit.machine.runtime import mitsuba
    from unlit.render.reference import path_trace
    from unlit.scene.mesh import Mesh

    program = os.environ.get("UNLIT_TEST_BLENDER") or shutil.which("blender")
    if program is None:
        if find_spec("bpy") is None:
            pytest.skip("no Blender: install it, or the package bpy")
        program = sys.executable
    out = everything.parent / "blender.exr"
    script = ["blender.py", "--", str(out)]
    if Path(program).name.startswith("blender"):
        script = ["--background", "--python", *script]
    subprocess.run([program, *script], cwd=everything, check=True, capture_output=True, timeout=600)
    theirs = np.array(mitsuba().Bitmap(str(out)))[..., :3].astype(np.float32)
    light = r.light.rasterize()
    ours = path_trace(
        Mesh(r.face.mesh.vertices, r.face.mesh.triangles),
        r.face.camera,
        r.face.maps,
        light,
        128,
        bounces=3,
    )
    inside = r.face.mask > 0
    error = encode_srgb(np.clip(ours, 0, 1)) - encode_srgb(np.clip(theirs, 0, 1))
    assert -10 * np.log10((error[inside] ** 2).mean()) > 30


@pytest.mark.parametrize("chosen", LAYOUTS)
def test_all_files_have_the_layout_of_the_atlas(tmp_path, chosen):
    """OBJ, PLY and glTF name the same texture coordinates, which are those that were baked."""
    trimesh = pytest.importorskip("trimesh")
    r = with_outline(small_head(64))
    folder = export(r, tmp_path / "out", tmp_path, ["obj", "ply", "glb"], layout=chosen)
    table = tomllib.loads((folder / "export.toml").read_text())
    assert (table["size"], table["layout"]) == (512, chosen)
    uv = layout.laid_out(r, chosen).face.mesh.uv
    lines = (folder / "mesh.obj").read_text().splitlines()
    written = np.array([line.split()[1:] for line in lines if line.startswith("vt ")], float)
    np.testing.assert_allclose(written, uv, atol=1e-6)
    ply = trimesh.load(folder / "mesh.ply", process=False)
    head = trimesh.load(folder / "face.glb", process=False)
    corners = KDTree(uv)
    for found in (ply.visual.uv, *(part.visual.uv for part in head.geometry.values())):
        assert corners.query(np.asarray(found))[0].max() < 1e-5
    with pytest.raises(SettingsError, match="layout back: choose from face, head"):
        export(r, tmp_path / "wrong", tmp_path, ["ply"], 512, layout="back")
    with pytest.raises(SettingsError, match="scalp bald: choose from skin, hair"):
        export(r, tmp_path / "wrong", tmp_path, ["ply"], 512, scalp="bald")
