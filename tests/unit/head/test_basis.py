"""Reducing hand-made axes to an orthogonal basis that keeps their covariance."""

import numpy as np

from unlit.head.basis import principal_combinations, remove_similarity, vertex_areas


def test_basis_is_orthogonal_and_keeps_the_covariance():
    """Components are orthogonal under the weights, sorted, and sum to the axes' covariance."""
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(6, 10, 3))
    axes[5] = axes[0] + axes[1]  # overlapping axes are what the reduction is for
    deviations = np.array([1, 2, 0.5, 1, 1, 3.0])
    weights = rng.uniform(0.1, 1, 10)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    covariance = turn * deviations**2 @ turn.T
    rows = principal_combinations(axes, covariance, weights, keep=1 - 1e-9)
    basis = np.tensordot(rows, axes, axes=1)
    assert len(basis) == 5
    gram = np.einsum("ivx,v,jvx->ij", basis, weights, basis)
    size = np.diag(gram)
    assert np.abs(gram - np.diag(size)).max() < 1e-5 * size[0]
    assert (np.diff(size) <= 0).all()
    flat, given = basis.reshape(5, -1), axes.reshape(6, -1)
    np.testing.assert_allclose(flat.T @ flat, given.T @ covariance @ given, atol=1e-3)


def test_similarity_is_removed():
    """Moving, turning and scaling the whole leaves nothing behind; a real shape change stays."""
    rng = np.random.default_rng(2)
    shape = rng.normal(size=(30, 3))
    weights = rng.uniform(0.1, 1, 30)
    motions = [np.tile([1.0, 2, 3], (30, 1)), np.cross([0.3, 1, -2], shape), 0.5 * shape]
    motions.append(rng.normal(size=(30, 3)))
    rest = remove_similarity(np.stack(motions), shape, weights)
    assert np.abs(rest[:3]).max() < 1e-10
    assert np.abs(rest[3]).max() > 0.1
    np.testing.assert_allclose(remove_similarity(rest, shape, weights), rest, atol=1e-10)


def test_areas_sum_to_the_surface():
    """Vertex areas of a unit square's two triangles sum to one."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    areas = vertex_areas(square, np.array([[0, 1, 2], [0, 2, 3]]))
    np.testing.assert_allclose(areas, [1 / 3, 1 / 6, 1 / 3, 1 / 6])
