"""Tangents against the geometry they are defined by."""

import numpy as np

from small_head import grid_ball
from unlit.output.tangent import tangents

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
NORMAL = np.tile([0.0, 0, 1], (4, 1))
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def test_along_u_with_v_up():
    """On a square in the plane: u along x gives T = x; mirrored, B = sign N x T stays up."""
    plain = tangents(QUAD, NORMAL, QUAD[:, :2], TWO)
    np.testing.assert_allclose(plain, np.tile([1, 0, 0, 1], (4, 1)), atol=1e-6)
    mirrored = tangents(QUAD, NORMAL, QUAD[:, :2] * (-1, 1), TWO)
    np.testing.assert_allclose(mirrored, np.tile([-1, 0, 0, -1], (4, 1)), atol=1e-6)
    across = mirrored[:, 3:] * np.cross(NORMAL, mirrored[:, :3])
    np.testing.assert_allclose(across, np.tile([0, 1, 0], (4, 1)), atol=1e-6)


def test_on_a_globe():
    """On a globe the tangent points east: known in closed form away from the poles."""
    unit, triangles, uv, triangle_uv = grid_ball(31, 48, (0, 0, 1, 1))
    corner, at = triangles.ravel(), triangle_uv.ravel()
    found = tangents(unit[corner], unit[corner], uv[at], np.arange(len(corner)).reshape(-1, 3))
    welded = np.zeros((len(uv), 4))
    np.add.at(welded, at, found)
    inner = (uv[:, 1] > 0.2) & (uv[:, 1] < 0.8)
    phi = 2 * np.pi * uv[:, 0]
    east = np.stack([-np.cos(phi), np.zeros_like(phi), np.sin(phi)], axis=1)
    direction = welded[:, :3] / np.linalg.norm(welded[:, :3], axis=1, keepdims=True)
    assert ((direction * east).sum(axis=1)[inner] > np.cos(np.radians(4))).all()
    assert (found[:, 3] == 1).all()


def test_where_the_layout_is_a_point():
    """No direction of u: still a unit vector perpendicular to the normal."""
    lost = tangents(QUAD, NORMAL, np.zeros((4, 2)), TWO)
    np.testing.assert_allclose(np.linalg.norm(lost[:, :3], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(lost[:, 2], 0, atol=1e-6)
    assert (lost[:, 3] == 1).all()
