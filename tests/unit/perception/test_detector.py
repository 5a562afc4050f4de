"""The detector without its network: where it looks, how its answers are read and merged."""

from __future__ import annotations

import numpy as np
import pytest

from unlit.perception import detector
from unlit.perception.detector import anchors, detections
from unlit.perception.views import Pyramid, Square


def candidate(score: float, x: float, y: float, side: float, roll: float = 0.0) -> np.ndarray:
    """A row (16,) as the search gives it; the eyes level but for `roll`, radians."""
    row = np.zeros(16)
    row[:4] = score, x, y, side
    middle, eye = np.array([x, y]), 0.2 * side * np.array([np.cos(roll), np.sin(roll)])
    row[4:6], row[6:8] = middle - eye, middle + eye
    return row


def test_anchors_are_cell_centres() -> None:
    """Two in each of 16 x 16 cells, then six in each of 8 x 8, rows first."""
    assert anchors().shape == (896, 2)
    np.testing.assert_allclose(anchors()[[0, 1, 2]], [(1 / 32, 1 / 32)] * 2 + [(3 / 32, 1 / 32)])
    np.testing.assert_allclose(anchors()[512:518], [(1 / 16, 1 / 16)] * 6)
    np.testing.assert_allclose(anchors().mean(axis=0), 0.5)


@pytest.mark.parametrize("size", [(300, 300), (1000, 400), (200, 900)])
@pytest.mark.parametrize("division", [1, 2, 4])
def test_tiles_show_every_face_whole(size: tuple[int, int], division: int) -> None:
    """Any square of half a tile's side lies within some tile; tiles are never tiny."""
    width, height = size
    pyramid = Pyramid(np.zeros((height, width, 3), np.uint8))
    tiles = list(detector._views(pyramid, (division,), 0.0))
    side = max(size) / division
    if division > 1 and side < 128:
        assert not tiles
        return
    assert {tile.side for tile in tiles} == {side}
    for x in np.linspace(side / 4, width - side / 4, 9):
        for y in np.linspace(side / 4, height - side / 4, 9):
            far = [max(abs(tile.x - x), abs(tile.y - y)) for tile in tiles]
            assert min(far) <= side / 4 + 1e-6


def test_answers_of_the_network_are_placed_in_the_photo(monkeypatch: pytest.MonkeyPatch) -> None:
    """One anchor fires in the first view, with its box and eyes beside it: decoded by hand."""
    which = 16 * 2 * 8 + 2 * 8  # row 8, column 8 of the fine grid
    regressors, logits = np.zeros((1, 896, 16)), np.full((1, 896, 1), -50.0)
    logits[0, which] = 3.0
    regressors[0, which, :4] = 12.8, 0, 32, 32  # a tenth to the right, a quarter wide
    regressors[0, which, 4:8] = 6.4, -6.4, 19.2, 6.4  # eyes: 1/20 up-left, 1/20 down-right of it
    monkeypatch.setattr(detector, "network", lambda name: lambda pixels: (regressors, logits))
    pyramid = Pyramid(np.zeros((400, 400, 3), np.uint8))
    (found,) = detector._run(pyramid, [Square(200, 200, 400, 0.0)])
    centre = np.array([8.5 / 16, 8.5 / 16]) * 400
    box, eyes = centre + np.array([40, 0]), centre + np.array([(20, -20), (60, 20)])
    assert found[0] == pytest.approx(1 / (1 + np.exp(-3)))
    np.testing.assert_allclose(found[1:4], (*box, 100))
    np.testing.assert_allclose(found[4:8].reshape(2, 2), eyes)
    # In a view that is turned by a quarter, right becomes down.
    (turned,) = detector._run(pyramid, [Square(200, 200, 400, np.pi / 2)])
    away = box - 200
    np.testing.assert_allclose(turned[1:3], (200 - away[1], 200 + away[0]))


def test_one_face_is_merged_and_two_are_kept() -> None:
    """By overlap: the mean by score under the best score, best face first; weak ones only help."""
    rows = np.stack(
        [
            candidate(0.8, 100, 100, 50),
            candidate(0.9, 300, 100, 40),
            candidate(0.6, 107, 100, 50),
            candidate(0.7, 500, 100, 50),  # nobody joins it, and alone it is too weak
        ]
    )
    merged = detector._merge(rows)
    assert merged[:, 0].tolist() == [0.9, 0.8]
    assert merged[1, 1] == pytest.approx((0.8 * 100 + 0.6 * 107) / 1.4)
    assert merged[0, 1] == 300


@pytest.mark.parametrize(
    ("x", "side", "expected"), [(0, 10, 1), (5, 10, 1 / 3), (20, 10, 0), (0, 5, 0.25)]
)
def test_overlap_is_intersection_over_union(x: float, side: float, expected: float) -> None:
    one, other = candidate(1, 0, 0, 10), candidate(1, x, 0, side)
    assert detector._overlap(one, other[None])[0] == pytest.approx(expected)


def test_squares_are_level_with_the_eyes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the first search finds, with the roll of its eye line."""
    rows = candidate(0.9, 30, 40, 20, roll=0.3)[None]
    monkeypatch.setattr(detector, "_run", lambda pyramid, views: rows)
    ((square, score),) = next(detections(Pyramid(np.zeros((200, 200, 3), np.uint8))))
    assert (square.x, square.y, square.side, score) == (30, 40, 20, 0.9)
    assert square.angle == pytest.approx(0.3)
