"""The rim of an open mesh becomes a smooth loop, and nothing else moves."""

import numpy as np

from unlit.head.model import HeadModel
from unlit.head.rim import even_rim

ROWS, COLUMNS = 30, 48


def jagged_tube(rows: int = ROWS) -> tuple[np.ndarray, np.ndarray]:
    """A tube with a closed end above and teeth below: vertices (V, 3), triangles (F, 3)."""
    angle = np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False)
    height = np.linspace(0, 10, rows)[:, None] + 0.1 * (-1) ** np.arange(COLUMNS) * (
        np.arange(rows) == 0
    )[:, None].astype(float)
    ring = np.stack(np.broadcast_arrays(np.cos(angle), height, -np.sin(angle)), axis=2)
    vertices = np.concatenate([ring.reshape(-1, 3), [(0, 11, 0)]])
    first = np.arange((rows - 1) * COLUMNS).reshape(rows - 1, COLUMNS)
    right = np.roll(first, -1, axis=1)
    a, b, c, d = (x.ravel() for x in (first, right, right + COLUMNS, first + COLUMNS))
    top = np.arange((rows - 1) * COLUMNS, rows * COLUMNS)
    cap = np.stack([top, np.roll(top, -1), np.full(COLUMNS, len(vertices) - 1)], axis=1)
    triangles = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    return vertices, np.concatenate([triangles, cap])


def test_teeth_go_and_the_rest_stays():
    vertices, triangles = jagged_tube()
    evened = even_rim(triangles, len(vertices)) @ vertices
    assert np.ptp(vertices[:COLUMNS, 1]) > 0.19
    assert np.ptp(evened[:COLUMNS, 1]) < 1e-9
    np.testing.assert_allclose(np.hypot(*evened[:COLUMNS, [0, 2]].T), 1, atol=1e-9)
    np.testing.assert_array_equal(evened[15 * COLUMNS :], vertices[15 * COLUMNS :])
    assert (np.diff(evened[:-1, 1].reshape(ROWS, COLUMNS), axis=0) > 0).all()


def test_without_one_rim_nothing_is_moved():
    """Two open ends, or none."""
    vertices, triangles = jagged_tube()
    for some in (triangles[:-COLUMNS], np.concatenate([triangles, triangles[:, ::-1]])):
        evened = even_rim(some, len(vertices)) @ vertices
        np.testing.assert_array_equal(evened, vertices)


def test_the_default_head_ends_in_an_even_loop(head: HeadModel):
    """To a twentieth of a millimetre what it would be evened to."""
    rim = even_rim(head.triangles, len(head.neutral))
    assert np.abs(rim @ head.neutral - head.neutral).max() < 5e-3
