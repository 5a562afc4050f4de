"""Damaged folders of results: `load` gives a whole result or raises OutputError."""

import io
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from corrupt import damaged
from small_head import save_quickly, small_head
from unlit.errors import OutputError
from unlit.output.load import load
from unlit.output.save import save

FUZZ = settings.get_profile("fuzz")
NAMES = ("reconstruction.toml", "metrics.json", "reconstruction.npz")


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "result"
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(small_head(16), folder)
    return folder


@pytest.fixture(scope="module")
def broken(saved) -> Path:
    """A copy of which one file is broken at a time."""
    return Path(shutil.copytree(saved, saved.parent / "broken"))


def check(saved: Path, broken: Path, name: str, content: bytes) -> None:
    (broken / name).write_bytes(content)
    try:
        face = load(broken)
    except OutputError as error:
        assert "\n" not in str(error)
    else:
        assert face.face.mesh.triangles.max() < len(face.face.mesh.vertices)
        assert face.photo.image.shape == (len(face.photo.image), len(face.photo.image), 3)
    finally:
        shutil.copy(saved / name, broken / name)


@pytest.mark.parametrize("name", NAMES)
@settings(FUZZ)
@given(data=st.data())
def test_damaged_files(saved, broken, name, data):
    """Any damage to any of the three files that are read."""
    content = (saved / name).read_bytes()
    check(saved, broken, name, data.draw(damaged([content], head=1500)))


@settings(FUZZ)
@given(st.data())
def test_damaged_directory_of_the_archive(saved, broken, data):
    """The end of the archive, which is what is read first."""
    content = (saved / "reconstruction.npz").read_bytes()
    tail = data.draw(damaged([content[-1500:]], head=1500))
    check(saved, broken, "reconstruction.npz", content[:-1500] + tail)


HEADERS = (
    "{'descr': '<f4', 'fortran_order': False, 'shape': (16, 16, 3), }",
    "{'descr': '<f4', 'fortran_order': True, 'shape': (16, 16, 3), }",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (16L, 16L, 3L), }",
    "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (16, 16, 3), }",
)


@settings(FUZZ)
@given(damaged([header.encode() for header in HEADERS], head=60))
def test_damaged_headers_of_arrays(saved, broken, header):
    """Python in the header is never run, and no error of its reader gets out."""
    check_header(saved, broken, header)


@pytest.mark.parametrize(
    "header",
    [
        b"{'descr': '|O', 'fortran_order': False, 'shape': (16, 16, 3), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (4096, 4096, 3), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (-16, -16, 3), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (True, 16, 3), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (" + b"9" * 4400 + b",), }",
        b"(" * 4000,
        b"[" * 9000 + b"]" * 900,
        b"{'descr': " + b"[" * 500 + b"]" * 500 + b", 'fortran_order': False, 'shape': (1,), }",
        b"{'descr': '((', 'fortran_order': False, 'shape': (16, 16, 3), }",
        b"'''",
        b"\\",
        b"  1\n 2",
        b"\0",
    ],
)
def test_headers_made_to_break(saved, broken, header):
    """What NumPy's reader is known to answer in other ways than ValueError."""
    check_header(saved, broken, header)


def check_header(saved: Path, broken: Path, header: bytes) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(saved / "reconstruction.npz") as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "image.npy":
                start = 10 + int.from_bytes(content[8:10], "little")
                head = header + b"\n"
                content = content[:8] + len(head).to_bytes(2, "little") + head + content[start:]
            new.writestr(name, content)
    check(saved, broken, "reconstruction.npz", out.getvalue())


def test_an_archive_that_grows_when_read(saved, broken):
    """A member of a gigabyte of zeros, packed into a megabyte, under an image's header."""
    out = io.BytesIO()
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": (16, 16, 3)}
    )
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new, new.open("image.npy", "w") as file:
        file.write(header.getvalue())
        for _ in range(1024):
            file.write(bytes(1 << 20))
    check(saved, broken, "reconstruction.npz", out.getvalue())


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("claimed", [None, 99])
def test_other_compressions(saved, broken, method, claimed):
    """Methods that unlit does not write, whole and damaged, and one that nobody knows."""
    out = io.BytesIO()
    with (
        zipfile.ZipFile(saved / "reconstruction.npz") as old,
        zipfile.ZipFile(out, "w", method) as new,
    ):
        for name in old.namelist():
            new.writestr(name, old.read(name))
    content = bytearray(out.getvalue())
    if claimed:
        content[content.index(b"PK\x01\x02") + 10] = claimed
    check(saved, broken, "reconstruction.npz", bytes(content))
    content[100:300] = bytes(200)
    check(saved, broken, "reconstruction.npz", bytes(content))


def test_tables_made_to_last(saved, broken):
    """Keys of a hundred thousand parts and deep nesting end soon."""
    for text in ("a." * 100_000 + "a = 1", "a = " + "[" * 100_000):
        check(saved, broken, "reconstruction.toml", text.encode())
    check(saved, broken, "metrics.json", b"[" * 100_000)
    check(saved, broken, "metrics.json", b"1" * 100_000)
