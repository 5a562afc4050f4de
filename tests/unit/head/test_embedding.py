"""Casting landmarks onto a head and reading them back."""

import numpy as np

from unlit.head.embedding import _Head
from unlit.head.sources.makehuman_learnt import shipped_landmarks
from unlit.perception.topology import LEFT_EYE, RIGHT_EYE
from unlit.scene.surface_points import SurfacePoints


def test_cast_and_read_back(head):
    """Every landmark, cast along z onto the head, lands on itself: nothing hides another."""
    points = head.landmarks(head.neutral)
    triangle, barycentric, hits = _Head(head.neutral, head.triangles, head.vertex_region).cast(
        points[:, :2]
    )
    again = SurfacePoints(triangle, barycentric).on(head.neutral, head.triangles)
    np.testing.assert_allclose(again, hits, atol=1e-4)
    off = np.linalg.norm(again - points, axis=-1)
    # Not so where a rim was moved since, as the lips were when they were sealed.
    assert (off < 0.01).mean() > 0.93


def test_shipped_landmarks_are_symmetric(head):
    """The head is its own mirror image, and so are its landmarks."""
    points = head.landmarks(head.neutral)
    mirrored = points * (-1, 1, 1)
    apart = np.linalg.norm(points[:, None] - mirrored[None], axis=-1).min(axis=1)
    assert np.median(apart) < 0.01 and apart.max() < 0.3
    assert (shipped_landmarks().triangle >= 0).all()


def test_lid_rims_lie_on_the_lids(head):
    """Eyelid contours are on skin, not on the eyeball behind it, and frame the iris."""
    eyes = head.vertex_region == 2
    piece = head.triangles[head.landmark_points.triangle]
    points = head.landmarks(head.neutral)
    for rim, iris in ((RIGHT_EYE, 468), (LEFT_EYE, 473)):
        assert not eyes[piece[list(rim)]].all(axis=1).any()
        low, high = points[list(rim), :2].min(axis=0), points[list(rim), :2].max(axis=0)
        assert (low < points[iris, :2]).all() and (points[iris, :2] < high).all()
