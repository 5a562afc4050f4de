"""Damaged subjects: descriptions and meshes from anywhere raise SubjectError, and nothing else."""

import copy
import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plates
from corrupt import damaged
from unlit.errors import PictureError, SubjectError
from unlit.evaluate.subject_file import files_of
from unlit.evaluate.subject_mesh import read_subject
from unlit.storage.meshes import read_mesh

FUZZ = settings.get_profile("fuzz")
MAPS = """\
specular_albedo = { value = 0.5 }
roughness = { file = "albedo.png", encoding = "linear", scale = 0.5 }
normal = { file = "albedo.png", space = "tangent", green = "down" }
displacement = { file = "albedo.png", encoding = "linear", scale = 0.1, subdivisions = 1 }
"""
GLB = plates.glb()
MESHES = {
    ".obj": [plates.OBJ.encode()],
    ".ply": [plates.ply(s) for s in ("ascii", "binary_little_endian", "binary_big_endian")],
    ".glb": [GLB],
}


def check_mesh(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        surface = read_mesh(path)
    except SubjectError as error:
        assert "\n" not in str(error)
        return
    assert surface.triangles.max() < len(surface.vertices)
    assert np.isfinite(surface.vertices).all()


@pytest.mark.parametrize("kind", list(MESHES))
@settings(FUZZ)
@given(data=st.data())
def test_damaged_meshes(tmp_path_factory, kind, data):
    """Every index of what is read lies inside its table."""
    content = data.draw(damaged(MESHES[kind]))
    check_mesh(tmp_path_factory.getbasetemp() / f"mesh{kind}", content)


ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.sampled_from([[], {}, [[]], "", "VEC3", [1e308] * 16, [1] * 16, [0, 0, 0, 0]]),
)


@settings(FUZZ)
@given(st.data())
def test_glb_documents_of_wrong_types(tmp_path_factory, data):
    """Any value of the JSON part replaced by one of another type, size or sign."""
    length = int.from_bytes(GLB[12:16], "little")
    document, body = json.loads(GLB[20 : 20 + length]), GLB[28 + length :]
    for _ in range(data.draw(st.integers(1, 3))):
        place = document
        while True:
            keys = sorted(place) if isinstance(place, dict) else range(len(place))
            if not keys:
                break
            key = data.draw(st.sampled_from(list(keys)))
            inner = place[key]
            if not isinstance(inner, dict | list) or not inner or data.draw(st.booleans()):
                place[key] = copy.deepcopy(data.draw(ODD))
                break
            place = inner
    check_mesh(
        tmp_path_factory.getbasetemp() / "typed.glb",
        plates.glb_of(json.dumps(document).encode(), body),
    )


HEADER = (
    "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    "{}\nelement face {}\nproperty list {} int vertex_indices\nend_header\n"
)


@pytest.mark.parametrize("style", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize(
    ("vertices", "more", "faces", "counter"),
    [
        (20_000_000, "", 1, "uchar"),
        (3, "", 20_000_000, "uchar"),
        (3, "", 1, "float"),
        (3, "", 1, "double"),
        (3, "property list int double a\nproperty list uint float b", 1, "uint"),
        (3, "element nothing 20000000", 1, "uchar"),
        (3, "property float x", 1, "uchar"),
        (3, "element vertex 3", 1, "nosuch"),
    ],
)
def test_ply_headers_that_promise_more_than_there_is(
    tmp_path, style, vertices, more, faces, counter
):
    """Twenty million elements in a file of some bytes: no memory, no minutes."""
    header = HEADER.format(style, vertices, more, faces, counter).encode()
    check_mesh(tmp_path / "x.ply", header + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n" * 9)


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("subject")
    plates.folder(folder)
    return folder


def check_subject(file: Path) -> None:
    for read in (lambda: read_subject(file, 32), lambda: files_of(file)):
        try:
            read()
        except (SubjectError, PictureError) as error:
            assert "\n" not in str(error)


@settings(FUZZ, max_examples=100)
@given(damaged([(plates.MINIMAL + MAPS).encode()], head=2000))
def test_damaged_descriptions(place, content):
    """Any damage to the text."""
    (place / "damaged.toml").write_bytes(content)
    check_subject(place / "damaged.toml")


VALUES = st.sampled_from(
    [
        *("1", "-1", "0", "nan", "inf", "1e300", "true", '""', '"x"', "[]", "{}", "[[]]"),
        *("9" * 400, "1979-05-27", "[{}]", "{ file = 1 }", '{ file = "../../etc/passwd" }'),
        *('{ file = "/dev/zero" }', "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "[1e308,1,1]"),
        *('{ file = "albedo.png" }', '{ file = "plate.obj", encoding = "linear" }'),
    ]
)


@settings(FUZZ, max_examples=100)
@given(st.data())
def test_fields_of_wrong_types(place, data):
    """Any right-hand side replaced by one of another kind."""
    lines: list[str] = [*(plates.MINIMAL + MAPS).splitlines()]
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.sampled_from([k for k, line in enumerate(lines) if " = " in line]))
        name = lines[at].split(" = ")[0]
        lines[at] = f"{name} = {data.draw(VALUES)}"
    (place / "typed.toml").write_text("\n".join(lines))
    check_subject(place / "typed.toml")


def test_descriptions_made_to_last(tmp_path):
    """Keys of a hundred thousand parts, deep nesting, files without end."""
    for text in ("a." * 100_000 + "a = 1", "a = " + "[" * 100_000, "a = " + "{b=" * 5000):
        (tmp_path / "subject.toml").write_text(text)
        with pytest.raises(SubjectError):
            read_subject(tmp_path, 32)
    (tmp_path / "subject.toml").unlink()
    os.symlink("/dev/zero", tmp_path / "subject.toml")  # noqa: PTH211
    with pytest.raises(SubjectError):
        read_subject(tmp_path, 32)
