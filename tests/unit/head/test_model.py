"""The head model format: what is written is read back, and broken files are named, not trusted."""

import zipfile

import numpy as np
import pytest

from unlit.errors import ModelError
from unlit.head.model import LANDMARKS, HeadModel
from unlit.scene.surface_points import SurfacePoints


def tiny(**changes) -> HeadModel:
    """A tetrahedron with one identity component, one unit and one landmark."""
    rng = np.random.default_rng(0)
    carried = np.full(LANDMARKS, -1, np.int32)
    carried[3] = 1
    weights = np.zeros((LANDMARKS, 3), np.float32)
    weights[3] = (0.2, 0.3, 0.5)
    values = {
        "name": "tiny",
        "licence": "CC0-1.0",
        "origin": "test",
        "neutral": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32),
        "identity": rng.normal(size=(2, 4, 3)).astype(np.float32),
        "expression": rng.normal(size=(1, 4, 3)).astype(np.float32),
        "expression_names": ("jawOpen",),
        "triangles": np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
        "uv": np.zeros((1, 2), np.float32),
        "triangle_uv": np.zeros((4, 3), np.int32),
        "landmark_points": SurfacePoints(carried, weights),
        "vertex_region": np.zeros(4, np.uint8),
    }
    return HeadModel(**(values | changes))


def test_round_trip(tmp_path):
    """Every field survives the file bit for bit, and no temporary file stays behind."""
    model = tiny()
    model.save(tmp_path / "m.npz")
    read = HeadModel.load(tmp_path / "m.npz")
    assert list(read.content()) == list(model.content())
    for field, value in model.content().items():
        np.testing.assert_array_equal(read.content()[field], value, err_msg=field)
    with np.load(tmp_path / "m.npz") as arrays:
        assert arrays["landmark_triangle"][3] == 1 and arrays["landmark_barycentric"].shape[1] == 3
    assert [path.name for path in tmp_path.iterdir()] == ["m.npz"]


def test_vertices_are_linear():
    """S = S0 + B_id a + B_exp b, also for models without any component."""
    model = tiny()
    got = model.vertices(np.array([0.5, -2]), np.array([0.25]))
    want = model.neutral + 0.5 * model.identity[0] - 2 * model.identity[1]
    np.testing.assert_allclose(got, want + 0.25 * model.expression[0], rtol=1e-5)
    bare = tiny(identity=np.zeros((0, 4, 3), np.float32))
    np.testing.assert_array_equal(bare.vertices(np.zeros(0), np.zeros(1)), model.neutral)


def test_landmarks():
    """A carried landmark is the weighted mean of its triangle's corners, the others are NaN."""
    model = tiny()
    points = model.landmarks(model.neutral)
    np.testing.assert_allclose(points[3], 0.3 * model.neutral[1] + 0.5 * model.neutral[3])
    assert np.isnan(np.delete(points, 3, axis=0)).all()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("neutral", np.full((4, 3), np.nan, np.float32)),
        ("neutral", np.zeros((4, 3))),
        ("identity", np.zeros((2, 5, 3), np.float32)),
        ("expression_names", ("jawOpen", "jawOpen")),
        ("triangles", np.full((4, 3), 4, np.int32)),
        ("triangle_uv", np.full((4, 3), -1, np.int32)),
        ("vertex_region", np.full(4, 9, np.uint8)),
    ],
)
def test_wrong_field_is_named(field, value):
    """A field that does not fit is refused under its name."""
    with pytest.raises(ModelError, match=f"'{field}'"):
        tiny(**{field: value})


@pytest.mark.parametrize(
    ("field", "triangle", "weight"),
    [
        ("landmark_triangle", 4, 1 / 3),
        ("landmark_triangle", -2, 1 / 3),
        ("landmark_barycentric", 0, 0),
    ],
)
def test_wrong_landmarks_are_named(field: str, triangle: int, weight: float) -> None:
    """By the name of their array in the file."""
    points = SurfacePoints(
        np.full(LANDMARKS, triangle, np.int32), np.full((LANDMARKS, 3), weight, np.float32)
    )
    with pytest.raises(ModelError, match=f"'{field}'"):
        tiny(landmark_points=points)


def test_missing_field_and_version_are_named(tmp_path):
    """A file that lacks a field, or is of another version, says so with its own name."""
    tiny().save(tmp_path / "m.npz")
    arrays = dict(np.load(tmp_path / "m.npz"))
    np.savez(tmp_path / "lacking.npz", **{k: v for k, v in arrays.items() if k != "uv"})
    with pytest.raises(ModelError, match=r"lacking.*'uv' is missing"):
        HeadModel.load(tmp_path / "lacking.npz")
    arrays["version"] = np.asarray(99)
    np.savez(tmp_path / "newer.npz", **arrays)
    with pytest.raises(ModelError, match="version 99"):
        HeadModel.load(tmp_path / "newer.npz")


def test_files_that_are_no_models(tmp_path):
    """Absent, text, cut short, pickled, and lying about its size: one line each, no crash."""
    path = tmp_path / "m.npz"
    with pytest.raises(ModelError, match="no such"):
        HeadModel.load(path)
    path.write_text("not a zip")
    with pytest.raises(ModelError, match="not a head model"):
        HeadModel.load(path)
    tiny().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match="not a head model"):
        HeadModel.load(path)
    np.savez(path, format=np.array([{}], dtype=object))
    with pytest.raises(ModelError, match="does not fit its header"):
        HeadModel.load(path)
    with zipfile.ZipFile(path, "w") as archive, archive.open("neutral.npy", "w") as member:
        header = {"descr": "<f4", "fortran_order": False, "shape": (10**9, 3)}
        np.lib.format.write_array_header_1_0(member, header)
    with pytest.raises(ModelError, match="does not fit its header"):
        HeadModel.load(path)
