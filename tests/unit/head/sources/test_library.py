"""Head models by name: added ones are found, others are refused with what there is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from unlit.errors import ModelError
from unlit.head import files
from unlit.head.model import LANDMARKS, HeadModel
from unlit.head.sources import ict, library
from unlit.scene.surface_points import SurfacePoints


def triangle(name: str, size: float = 17.0) -> HeadModel:
    """The smallest head there is, with landmarks `size` cm apart."""
    carried = np.full(LANDMARKS, -1, np.int32)
    carried[:2] = 0
    weights = np.zeros((LANDMARKS, 3), np.float32)
    weights[:2, :2] = np.eye(2)
    return HeadModel(
        name=name,
        licence="CC0-1.0",
        origin="test",
        neutral=np.eye(3, dtype=np.float32) * np.float32(size),
        identity=np.zeros((0, 3, 3), np.float32),
        expression=np.zeros((0, 3, 3), np.float32),
        expression_names=(),
        triangles=np.array([[0, 1, 2]], np.int32),
        uv=np.zeros((1, 2), np.float32),
        triangle_uv=np.zeros((1, 3), np.int32),
        landmark_points=SurfacePoints(carried, weights),
        vertex_region=np.zeros(3, np.uint8),
    )


def test_what_is_added_is_found_by_name_and_by_file(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`add` keeps the model that was built; a file of one's own needs no adding."""
    monkeypatch.setattr(ict, "build", lambda source, reference, progress: triangle(source.name))
    (home / "copy").mkdir()
    path = library.add("ict", home / "copy", lambda *_: None)
    assert files.added() == {"ict": path}
    assert library.head_model("ict").name == "copy"
    triangle("mine").save(home / "mine.npz")
    assert library.head_model(str(home / "mine.npz")).name == "mine"


def test_the_named_folder_comes_first(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """UNLIT_MODELS wins over the user's own folder."""
    for place in ("heads", "named"):
        (home / place).mkdir()
        triangle(place).save(home / place / "ict.npz")
    assert library.head_model("ict").name == "heads"
    monkeypatch.setenv("UNLIT_MODELS", str(home / "named"))
    assert library.head_model("ict").name == "named"


@pytest.mark.parametrize("size", [0.17, 170.0, 6.7, 0.0])
def test_a_head_that_is_not_in_centimetres_is_refused(home: Path, size: float) -> None:
    """Metres, millimetres, inches, no extent at all: the photo would get the blame."""
    triangle("mine", size).save(home / "mine.npz")
    with pytest.raises(ModelError, match=r"mine\.npz: its landmarks span .* cm"):
        library.head_model(str(home / "mine.npz"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda home: library.head_model("flame"), "flame: no such head model; give makehuman or"),
        (lambda home: library.head_model("flame"), "unlit models add ict FOLDER"),
        (lambda home: library.head_model(str(home / "no.npz")), "no.npz: no such head model file"),
        (lambda home: library.add("flame", home, print), "flame: no such head model to add"),
        (lambda home: library.add("ict", home / "no", print), "not a folder"),
    ],
)
def test_mistakes_are_one_line(home: Path, call, message: str) -> None:
    """With what there is to choose from."""
    with pytest.raises(ModelError) as error:
        call(home)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
