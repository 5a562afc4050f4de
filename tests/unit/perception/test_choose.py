"""Which of a photo's faces is reconstructed."""

import numpy as np
import pytest

from unlit.cli import main
from unlit.errors import FaceError
from unlit.perception.landmarks import DetectedFace, check_choice, choose


def face(left: float, size: float) -> DetectedFace:
    return DetectedFace(np.zeros((478, 3), np.float32), {}, 1.0, (left, 10, left + size, 10 + size))


#: From large to small, as they are found; the second stands left, the third right.
FACES = [face(400, 300), face(50, 200), face(650, 90), face(420, 80)]


@pytest.mark.parametrize(
    ("which", "number"), [("largest", 0), ("left", 1), ("right", 2), (0, 0), (3, 3)]
)
def test_choice(which: str | int, number: int) -> None:
    assert choose(FACES, which, "a.jpg") is FACES[number]
    assert choose(FACES[:1], "only", "a.jpg") is FACES[0]


@pytest.mark.parametrize("which", ["leftmost", "all", "0", -1])
def test_names_that_no_photo_has(which: str | int) -> None:
    """They are refused whatever was found, with what exists."""
    with pytest.raises(FaceError, match=f"face={which!r}: choose only, largest, left, right, or"):
        check_choice(which)
    with pytest.raises(FaceError, match="choose only"):
        choose(FACES, which, "a.jpg")


@pytest.mark.parametrize(
    ("which", "reason"),
    [
        ("only", "4 faces found; choose the face largest, left, right or N"),
        (4, "no face 4; 4 found: use largest, left, right or 0 to 3"),
    ],
)
def test_no_choice(which: str | int, reason: str) -> None:
    with pytest.raises(FaceError, match=reason):
        choose(FACES, which, "a.jpg")
    with pytest.raises(FaceError, match="no face found"):
        choose([], which, "a.jpg")
    with pytest.raises(FaceError, match="only one found: do not choose"):
        choose(FACES[:1], 1, "a.jpg")


def test_the_command_takes_them(capsys: pytest.CaptureFixture[str]) -> None:
    """`left` reaches the photo; another word is refused before anything is read."""
    assert main(["reconstruct", "none.jpg", "-o", "out", "--face", "left"]) == 1
    assert "none.jpg" in capsys.readouterr().err
    assert main(["reconstruct", "none.jpg", "-o", "out", "--face", "middle"]) == 2
    assert "write largest, left, right, or a number" in capsys.readouterr().err
    assert main(["reconstruct", "none.jpg", "-o", "out", "--face", "all"]) == 2
    assert "`unlit batch` can do" in capsys.readouterr().err
