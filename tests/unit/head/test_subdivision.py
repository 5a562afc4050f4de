"""Catmull-Clark as a matrix: known limits, partition of unity, orientation."""

import numpy as np

from unlit.head.subdivision import catmull_clark, triangulate

CUBE = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)


def test_cube():
    """The cube's points after one step are known: corners at 5/9, edges at 3/4 of the way out."""
    matrix, split = catmull_clark(CUBE, 8)
    fine = matrix @ CORNERS * 2 - 1
    assert fine.shape == (26, 3) and split.shape == (24, 4)
    radius = np.sort(np.linalg.norm(fine, axis=-1))
    want = np.sort([5 / 9 * np.sqrt(3)] * 8 + [0.75 * np.sqrt(2)] * 12 + [1.0] * 6)
    np.testing.assert_allclose(radius, want, atol=1e-6)


def test_partition_of_unity():
    """Rows sum to one and are not negative, on closed and open meshes, smooth or not."""
    for quads in (CUBE, CUBE[:3]):
        for smooth in (True, False):
            matrix, _ = catmull_clark(quads, 8, smooth)
            np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-6)
            assert matrix.min() >= 0


def test_boundary_is_a_curve_of_its_own():
    """A flat open grid stays flat, and its straight boundary stays straight."""
    ys, xs = np.mgrid[0:4, 0:4]
    grid = np.stack([xs, ys, 0 * xs], axis=-1).reshape(-1, 3).astype(float)
    index = np.arange(16).reshape(4, 4)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1)
    matrix, split = catmull_clark(quads.reshape(-1, 4), 16)
    fine = matrix @ grid
    assert np.abs(fine[:, 2]).max() == 0
    assert np.isclose(fine[:, 0].min(), 0)
    assert (fine[:, 0] < 1e-6).sum() == 7 - 2  # the two corners are rounded off
    a, b, c = (fine[triangulate(split)[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
