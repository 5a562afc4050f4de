"""Vertex normals in NumPy: those of the renderer, and those of seams."""

from __future__ import annotations

import numpy as np

from bumpy_head import ball, bumpy_head
from unlit.scene.mesh import Mesh
from unlit.scene.normals import vertex_normals


def test_normals_are_those_of_the_renderer() -> None:
    """Files and renders must shade alike; the renderer computes its own in Dr.Jit."""
    vertices, triangles = bumpy_head(3)
    expected = Mesh(vertices, triangles).normals.numpy().T
    np.testing.assert_allclose(vertex_normals(vertices, triangles), expected, atol=1e-5)


def test_normals_point_outwards_and_lone_vertices_have_none() -> None:
    """Counter-clockwise from outside; a vertex of no triangle gives zero, not NaN."""
    unit, triangles = ball(3)
    normal = vertex_normals(np.concatenate([unit, [[0, 0, 0]]]), triangles)
    assert (normal[:-1] * unit).sum(axis=1).min() > 0.999
    assert (normal[-1] == 0).all()


def test_seams_do_not_show() -> None:
    """A ball cut along an edge of each triangle: vertices of one point share the whole's normal."""
    unit, triangles = ball(2)
    cut = unit[triangles].reshape(-1, 3)
    normal = vertex_normals(cut, np.arange(len(cut)).reshape(-1, 3), triangles.ravel())
    np.testing.assert_allclose(normal, vertex_normals(unit, triangles)[triangles.ravel()])
