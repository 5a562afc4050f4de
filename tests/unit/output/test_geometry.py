"""Mesh files hold the mesh: read back by a small independent reader."""

import numpy as np

from unlit.output.geometry import mtl, obj, ply
from unlit.output.parts import EYES, PARTS, SKIN
from unlit.output.textures import PNGS


def test_obj(face):
    """Positions to the bit of float32, and separate indices that count from 1."""
    skin = np.full(len(face.face.mesh.triangles), SKIN, np.uint8)
    lines = [line.split() for line in obj(face, skin, "mesh.mtl").decode().splitlines()]
    numbers = {
        kind: np.array([line[1:] for line in lines if line[0] == kind], dtype=np.float32)
        for kind in ("v", "vt", "vn")
    }
    np.testing.assert_array_equal(numbers["v"], face.face.mesh.vertices)
    np.testing.assert_array_equal(numbers["vt"], face.face.mesh.uv)
    assert numbers["vn"].shape == face.face.mesh.vertices.shape
    faces = (
        np.array([[c.split("/") for c in line[1:]] for line in lines if line[0] == "f"], int) - 1
    )
    np.testing.assert_array_equal(faces[..., 0], face.face.mesh.triangles)
    np.testing.assert_array_equal(faces[..., 1], face.face.mesh.triangle_uv)
    np.testing.assert_array_equal(faces[..., 2], face.face.mesh.triangles)


def test_materials(face):
    """Faces are grouped by part; every material is defined once, of textures that are written."""
    part = (np.arange(len(face.face.mesh.triangles)) % 3 == 0).astype(
        np.uint8
    )  # SKIN and EYES mixed
    lines = obj(face, part, "some.mtl").decode().splitlines()
    assert "mtllib some.mtl" in lines
    groups: dict[str, int] = {}
    name = ""
    for line in lines:
        if line.startswith("usemtl "):
            name = line.removeprefix("usemtl ")
            assert name not in groups
        groups[name] = groups.get(name, 0) + line.startswith("f ")
    assert groups["eyes"] == (part == EYES).sum()
    assert groups["skin"] == (part == SKIN).sum()
    words = [line.split() for line in mtl(part).decode().splitlines()]
    assert [word[1] for word in words if word[0] == "newmtl"] == [PARTS[SKIN], PARTS[EYES]]
    assert {word[-1] for word in words if word[-1].endswith(".png")} <= set(PNGS)


def test_ply(face):
    """Each corner has its position and its texture coordinate, also on the seam."""
    header, _, body = ply(face).partition(b"end_header\n")
    words = header.decode().split()
    counts = [
        int(words[words.index("element", start) + 2]) for start in (0, words.index("face") - 1)
    ]
    vertex = np.frombuffer(body, "<f4", counts[0] * 8).reshape(-1, 8)
    faces = np.frombuffer(body[vertex.nbytes :], np.dtype([("n", "u1"), ("i", "<i4", 3)]))
    assert counts[1] == len(faces) == len(face.face.mesh.triangles)
    assert (faces["n"] == 3).all()
    np.testing.assert_array_equal(
        vertex[faces["i"], :3], face.face.mesh.vertices[face.face.mesh.triangles]
    )
    np.testing.assert_array_equal(
        vertex[faces["i"], 6:], face.face.mesh.uv[face.face.mesh.triangle_uv]
    )
    np.testing.assert_allclose(np.linalg.norm(vertex[:, 3:6], axis=1), 1, atol=1e-5)
