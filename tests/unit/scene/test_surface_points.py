"""Points carried by triangles: where they are, and where there is none."""

import numpy as np

from unlit.scene.surface_points import SurfacePoints

VERTICES = np.array([[0, 0, 0], [4, 0, 0], [0, 8, 0], [0, 0, 2]], np.float32)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def test_points_are_where_their_weights_say_and_follow_the_mesh() -> None:
    """Also on another mesh of the same triangles; a point that none carries is NaN."""
    points = SurfacePoints(
        np.array([0, -1, 1], np.int32),
        np.array([[0.25, 0.5, 0.25], [0, 0, 0], [0, 0, 1]], np.float32),
    )
    expected = np.array([[2, 2, 0], [np.nan] * 3, [0, 0, 2]])
    placed = points.on(VERTICES, TRIANGLES)
    assert placed.dtype == np.float32
    np.testing.assert_array_equal(placed, expected)
    np.testing.assert_array_equal(points.on(VERTICES + 3, TRIANGLES), expected + 3)


def test_empty_points_are_none() -> None:
    """As many as asked for, of the documented types."""
    points = SurfacePoints.empty(5)
    assert points.triangle.dtype == np.int32 and points.barycentric.dtype == np.float32
    assert np.isnan(points.on(VERTICES, TRIANGLES)).all()
    assert points.on(VERTICES, TRIANGLES).shape == (5, 3)
