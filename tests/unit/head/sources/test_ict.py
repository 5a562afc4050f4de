"""ICT-FaceKit's OBJ folder read into a head model: shapes, names, what is left out, and errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from unlit.errors import ModelError
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.head.sources import ict
from unlit.scene.surface_points import SurfacePoints

# A head of 12 vertices: a face (0-5), something to be left out (6-8), an eyeball (9-11).
PARTS = ((0, 6, "skin"), (9, 12, "eyes"))
FACES = ((0, 1, 2), (3, 4, 5), (6, 7, 8), (9, 10, 11), (0, 1, 6))
ACTIONS = ("mouthSmile_L", "jawOpen")


def obj(vertices: np.ndarray, faces: tuple = ()) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"vt {k / 12} 0.5" for k in range(12)] if faces else []
    lines += ["f " + " ".join(f"{k + 1}/{k + 1}" for k in face) for face in faces]
    return "\n".join(lines) + "\n"


def build(folder: Path) -> HeadModel:
    """The model, of a repository whose other head is not asked (below)."""
    return ict.build(folder, lambda: None, lambda *_: None)  # type: ignore[arg-type]


@pytest.fixture
def neutral() -> np.ndarray:
    return np.random.default_rng(0).uniform(-5, 5, (12, 3)).round(3)


@pytest.fixture
def repository(tmp_path: Path, neutral: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the repository with a tiny head; the landmarker is not asked."""
    folder = tmp_path / "copy" / "FaceXModel"
    folder.mkdir(parents=True)
    (folder / "generic_neutral_mesh.obj").write_text(obj(neutral, FACES))
    for k in range(2):
        (folder / f"identity{k:03d}.obj").write_text(obj(neutral + np.array([k + 1, 0, 0])))
    for k, name in enumerate(ACTIONS):
        (folder / f"{name}.obj").write_text(obj(neutral + np.array([0, 0.1 * (k + 1), 0])))
    (folder / "vertex_indices.json").write_text(json.dumps({"expressions": ACTIONS}))
    points = SurfacePoints(
        np.zeros(478, np.int32), np.tile(np.array([1, 0, 0], np.float32), (478, 1))
    )
    monkeypatch.setattr(ict, "_VERTICES", 12)
    monkeypatch.setattr(ict, "_IDENTITIES", 2)
    monkeypatch.setattr(ict, "_PARTS", PARTS)
    monkeypatch.setattr(ict, "embed_landmarks", lambda *_, **__: points)
    monkeypatch.setattr(ict, "MULTI_PIE", 17 * (0, 1, 2, 3))
    monkeypatch.setattr(ict, "_aligned", lambda neutral, head: neutral)
    monkeypatch.setattr(ict, "_borrowed", lambda skin, head: np.zeros(len(skin), np.uint8))
    monkeypatch.setattr(ict, "_without_strays", lambda found, *_: found)
    return folder.parent


def test_shapes_are_displacements_of_what_is_kept(repository: Path, neutral: np.ndarray) -> None:
    """Kept vertices in order, offsets from the neutral, ARKit's names, whole triangles only."""
    model = build(repository)
    kept = [0, 1, 2, 3, 4, 5, 9, 10, 11]
    np.testing.assert_allclose(model.neutral, neutral[kept], atol=1e-5)
    for k in range(2):
        np.testing.assert_allclose(model.identity[k], np.tile((k + 1, 0, 0), (9, 1)), atol=1e-5)
        offset = np.tile((0, 0.1 * (k + 1), 0), (9, 1))
        np.testing.assert_allclose(model.expression[k], offset, atol=1e-5)
    assert model.expression_names == ("mouthSmileLeft", "jawOpen")
    assert model.triangles.tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    # The texture's corner is the vertex's own in this file.
    u = model.uv[model.triangle_uv][..., 0]
    np.testing.assert_allclose(u, np.array([kept[k] for k in range(9)]).reshape(3, 3) / 12)
    assert (model.vertex_region[6:] == VERTEX_REGIONS.index("eyes")).all()


def test_the_inner_folder_will_do(repository: Path) -> None:
    """FaceXModel itself instead of the copy that holds it."""
    assert len(build(repository / "FaceXModel").identity) == 2


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: (f / "generic_neutral_mesh.obj").unlink(), "holds no generic_neutral_mesh.obj"),
        (
            lambda f: (f / "generic_neutral_mesh.obj").write_text(obj(np.zeros((3, 3)), FACES[:1])),
            "3 vertices, not 12",
        ),
        (lambda f: [x.unlink() for x in f.glob("identity*")], "2 of 4 shapes are missing"),
        (
            lambda f: (f / "identity001.obj").unlink(),
            "1 of 4 shapes are missing, identity001.obj first; copy the whole folder",
        ),
        (
            lambda f: (f / "identity001.obj").write_text(obj(np.zeros((5, 3)))),
            "identity001.obj: has 5 vertices, the neutral head 12",
        ),
        (lambda f: (f / "identity001.obj").write_text("v 1 two 3\n"), "not a whole .obj file"),
        (lambda f: (f / "jawOpen.obj").unlink(), "1 of 4 shapes are missing, jawOpen.obj first"),
        (lambda f: (f / "vertex_indices.json").unlink(), "vertex_indices.json: missing"),
        (lambda f: (f / "vertex_indices.json").write_text("[1, 2"), "list of facial actions"),
        (
            lambda f: (f / "vertex_indices.json").write_text('{"expressions": ["../../secret"]}'),
            "not a list of names",
        ),
    ],
)
def test_a_wrong_folder_is_one_line(repository: Path, damage, message: str) -> None:
    """Names the file and what is wrong with it."""
    damage(repository / "FaceXModel")
    with pytest.raises(ModelError) as error:
        build(repository)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
