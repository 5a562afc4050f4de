"""Rows of teeth go where the photo shows teeth, and never into the lips."""

from __future__ import annotations

import numpy as np
import pytest

from unlit.fit.state import State
from unlit.fit.teeth import _room, teeth_placed, without_teeth
from unlit.head.contact import pieces
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.scene.camera import Camera
from unlit.scene.mesh import Mesh

CAMERA = Camera(512, 512, 1500.0, 256, 256)


def state_of(head: HeadModel, **units: float) -> State:
    """Frontal, with these expressions."""
    expression = np.zeros(len(head.expression))
    for name, amount in units.items():
        expression[head.expression_names.index(name)] = amount
    return State(np.eye(3), np.array([0, 4.0, -80.0]), np.zeros(len(head.identity)), expression)


@pytest.fixture(scope="module")
def rows(head: HeadModel) -> tuple[np.ndarray, np.ndarray]:
    """Vertex masks of the upper and the lower row."""
    piece = pieces(head)
    teeth = head.vertex_region == VERTEX_REGIONS.index("teeth")
    found = [piece == number for number in np.unique(piece[teeth])]
    lower, upper = sorted(found, key=lambda row: head.neutral[row, 1].mean())
    return upper, lower


def clear_of_lips(head: HeadModel, shape: np.ndarray, rows: tuple[np.ndarray, ...]) -> bool:
    """Whether no point of the rows stands in the lips, but for those deep in the cheeks."""
    piece = pieces(head)
    skin = head.triangles[piece[head.triangles[:, 0]] == np.bincount(piece).argmax()]
    flesh = Mesh(shape.astype(np.float32), skin)
    rooms = np.concatenate([_room(flesh, shape[row]) for row in rows])
    return not ((rooms < -0.12) & (rooms > -0.8)).any()


def placed_in(head: HeadModel, state: State, shape: np.ndarray, teeth: np.ndarray) -> np.ndarray:
    """Vertices (V, 3), model frame; those that are no teeth must not have changed in the world."""
    world = state.placed(shape).astype(np.float32)
    found = teeth_placed(head, world, state, CAMERA, teeth)
    others = head.vertex_region != VERTEX_REGIONS.index("teeth")
    np.testing.assert_array_equal(found[others], world[others])
    return (found - state.translation) @ state.rotation


def shown(state: State, shape: np.ndarray, head: HeadModel, edge: float) -> np.ndarray:
    """(512, 512) bool: the mouth's opening down to the height `edge`, cm of the model."""
    lips = head.landmarks(shape)
    box = np.array([[-2.5, lips[13, 1], lips[13, 2]], [2.5, edge, lips[13, 2]]])
    (x0, y0), (x1, y1) = CAMERA.project(state.placed(box)).astype(int)
    seen = np.zeros((512, 512), dtype=bool)
    seen[y0:y1, x0:x1] = True
    return seen


def test_the_head_that_is_fitted_has_no_teeth(head: HeadModel) -> None:
    """Its triangles are those of skin and eyeballs, its landmarks where they were."""
    bare = without_teeth(head)
    assert len(np.unique(pieces(bare)[bare.triangles[:, 0]])) == 3
    np.testing.assert_array_equal(bare.landmarks(head.neutral), head.landmarks(head.neutral))
    np.testing.assert_array_equal(without_teeth(bare).triangles, bare.triangles)


def test_the_upper_row_ends_where_the_photo_shows_its_end(
    head: HeadModel, rows: tuple[np.ndarray, np.ndarray]
) -> None:
    """A jaw that is open: the row comes down into the opening, near the lips, the face stays."""
    state = state_of(head, jawOpen=0.3)
    shape = head.vertices(state.identity, state.expression)
    lips = head.landmarks(shape)
    edge = 0.3 * lips[13, 1] + 0.7 * lips[14, 1]
    teeth = shown(state, shape, head, edge)
    placed = placed_in(head, state, shape, teeth)
    upper, _ = rows
    middle = upper & (np.abs(shape[:, 0]) < 1.5)
    assert placed[middle, 1].min() == pytest.approx(edge - 0.2, abs=0.08)
    assert shape[middle, 1].min() > edge + 0.2
    assert lips[13, 2] - 1.5 < placed[middle, 2].max() < max(lips[13, 2], lips[14, 2])
    assert clear_of_lips(head, placed, rows)


def test_rows_that_a_dark_gap_parts_are_placed_apart(
    head: HeadModel, rows: tuple[np.ndarray, np.ndarray]
) -> None:
    """The lower row begins where pale pixels begin again, the upper one ends above the gap."""
    state = state_of(head, jawOpen=0.5)
    shape = head.vertices(state.identity, state.expression)
    lips = head.landmarks(shape)
    first, second = (w * lips[13, 1] + (1 - w) * lips[14, 1] for w in (0.7, 0.3))
    whole = shown(state, shape, head, lips[14, 1])
    gap = shown(state, shape, head, second) & ~shown(state, shape, head, first)
    assert first - second > 0.4
    placed = placed_in(head, state, shape, whole & ~gap)
    upper, lower = (row & (np.abs(shape[:, 0]) < 1.5) for row in rows)
    assert placed[upper, 1].min() == pytest.approx(first - 0.2, abs=0.1)
    assert placed[lower, 1].max() == pytest.approx(second + 0.2, abs=0.1)
    assert clear_of_lips(head, placed, rows)


def test_teeth_that_are_not_seen_stay_behind_closed_lips(
    head: HeadModel, rows: tuple[np.ndarray, np.ndarray]
) -> None:
    """Pursed lips are drawn over the rows, which go back."""
    nothing = np.zeros((512, 512), dtype=bool)
    for units in ({}, {"mouthRollUpper": 0.6, "mouthRollLower": 0.6}):
        state = state_of(head, **units)
        shape = head.vertices(state.identity, state.expression)
        placed = placed_in(head, state, shape, nothing)
        assert clear_of_lips(head, placed, rows)
        upper, lower = rows
        np.testing.assert_allclose(placed[:, :2], shape[:, :2], atol=2e-5)
        assert (placed[upper | lower, 2] <= shape[upper | lower, 2] + 2e-5).all()
