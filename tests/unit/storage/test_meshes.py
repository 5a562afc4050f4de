"""Readers of OBJ, PLY and GLB: the same plate from each, and what they refuse."""

from pathlib import Path

import numpy as np
import pytest

import plates
from unlit.errors import SubjectError
from unlit.storage.meshes import read_mesh


@pytest.mark.parametrize(
    ("name", "content", "shift"),
    [
        ("a.obj", plates.OBJ.encode(), 0),
        ("a.ply", plates.ply("ascii"), 0),
        ("a.ply", plates.ply("binary_little_endian"), 0),
        ("a.PLY", plates.ply("binary_big_endian"), 0),
        ("a.glb", plates.glb(), 1),
    ],
)
def test_the_same_plate(tmp_path: Path, name: str, content: bytes, shift: float) -> None:
    """Positions, texture coordinates and triangles; a GLB's nodes move their meshes."""
    path = tmp_path / name
    path.write_bytes(content)
    surface = read_mesh(path)
    assert surface.uv is not None and surface.triangle_uv is not None
    corners = surface.vertices[surface.triangles]
    assert corners == pytest.approx((plates.VERTICES + np.array([shift, 0, 0]))[plates.TRIANGLES])
    assert surface.uv[surface.triangle_uv] == pytest.approx(plates.UV[plates.TRIANGLES])


def test_without_texture_coordinates(tmp_path: Path) -> None:
    """Faces without vt are a mesh without them."""
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 2//1 3//1\n")
    assert read_mesh(path).uv is None


#: Each node twice the child of the one before: 2^40 paths to the mesh.
DOUBLING = [{"children": [k + 1, k + 1]} for k in range(40)] + [{"mesh": 0}]


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.stl", b"", "not a mesh; give"),
        ("a.obj", b"", "no triangles"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 3\n", "names a vertex that is not there"),
        ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("a.obj", b"v 0 x 0\n", "not a whole .obj"),
        ("a.ply", b"solid", "not a whole .ply"),
        ("a.ply", plates.ply("ascii")[:-20], "not a whole .ply|not finite|no triangles"),
        ("a.ply", plates.ply("binary_big_endian")[:-20], "not a whole .ply"),
        ("a.ply", plates.ply("ascii")[:-4], "not a whole .ply"),
        ("a.ply", plates.ply("ascii").replace(b"vertex_ind", b"other"), "without vertex_indices"),
        ("a.obj", b"v 0 0 0\nf 99999999999999999999 1 1\n", "not a whole .obj"),
        ("a.glb", b"glTF", "not a whole .glb"),
        ("a.glb", plates.glb_of(b"[]"), "not a whole .glb"),
        ("a.glb", plates.glb_of(b"[" * 100_000), "not a whole .glb"),
        ("a.glb", plates.glb(nodes=[1]), "not a whole .glb"),
        ("a.glb", plates.glb(nodes=DOUBLING), "a node has two parents"),
        ("a.glb", plates.glb()[:-20], "not a whole .glb"),
        ("a.glb", plates.glb(extensionsRequired=["KHR_draco_mesh_compression"]), "needs KHR_draco"),
        ("a.glb", plates.glb(nodes=[{"children": [0], "mesh": 0}]), "no mesh|not a whole"),
    ],
)
def test_refused(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    """One line that names the file, whatever is wrong with it."""
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SubjectError, match=reason) as caught:
        read_mesh(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_not_there(tmp_path: Path) -> None:
    """The system's reason, not a traceback."""
    with pytest.raises(SubjectError, match="No such file"):
        read_mesh(tmp_path / "a.obj")


def test_a_cut_glb_never_reads_beyond_its_end(tmp_path: Path) -> None:
    """An accessor that claims more than the file has is refused, not read."""
    path = tmp_path / "a.glb"
    accessor = {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": 10_000_000}
    small = {"bufferView": 0, "componentType": 5123, "type": "SCALAR", "count": 6}
    path.write_bytes(plates.glb(np.zeros((4, 2)), accessors=[small, accessor, accessor]))
    with pytest.raises(SubjectError, match=r"not a whole \.glb"):
        read_mesh(path)


@pytest.mark.parametrize("stride", [-12, 0, 11, 4096])
def test_a_stride_never_leaves_the_buffer(tmp_path: Path, stride: int) -> None:
    """glTF allows the size of one element to 252 bytes; others would read foreign memory."""
    views = [{"byteOffset": start} for start in (0, 12, 60)]
    views[1]["byteStride"] = stride
    path = tmp_path / "a.glb"
    path.write_bytes(plates.glb(bufferViews=views))
    with pytest.raises(SubjectError, match=f"a stride of {stride} bytes"):
        read_mesh(path)
