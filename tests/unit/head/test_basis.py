"""Hand-made axes without moves of the whole, and areas."""

import numpy as np

from unlit.head.basis import remove_similarity, vertex_areas


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
