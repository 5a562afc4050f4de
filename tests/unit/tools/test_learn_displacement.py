"""Displacements along normals: a known bump is found again, and what is shipped makes sense."""

from __future__ import annotations

import numpy as np
from learn_displacement import Registration
from learn_prior import Surface
from scipy.spatial import KDTree

from unlit.head.contact import eyeballs
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.head.sources.makehuman_learnt import shipped_displacement
from unlit.scene.normals import vertex_normals


def test_a_known_bump_is_found_and_the_rim_is_no_evidence(head: HeadModel) -> None:
    """2 mm on one cheek come back there to a fifth, and not where the surface is rim."""
    registration = Registration(head)
    heights = np.zeros(len(head.neutral))
    cheeks = []
    for side in (-1, 1):
        middle = head.neutral[registration.skin][
            np.linalg.norm(head.neutral[registration.skin] - (side * 4, -4, 1), axis=1).argmin()
        ]
        distance = np.linalg.norm(head.neutral - middle, axis=1)
        heights += 0.2 * np.exp(-(distance**2) / 2) * registration.skin
        cheeks.append(distance)
    points = head.neutral + heights[:, None] * registration.normals
    normals = vertex_normals(points, head.triangles)
    surface = Surface(points, normals, points[:0], rim=cheeks[1] < 3)
    found = registration.heights(surface, np.zeros(len(head.identity)))
    near = [registration.skin & (distance < 0.7) for distance in cheeks]
    assert np.abs(found - heights)[near[0]].max() < 0.2 * heights[near[0]].max()
    assert np.abs(found[near[1]]).max() < 0.5 * heights[near[1]].min()
    assert np.abs(found[head.neutral[:, 1] > 4]).max() < 0.01


def test_shipped_displacements_are_millimetres_and_their_mean_symmetric(head: HeadModel) -> None:
    """One height per vertex, teeth and tongue left out, which come last; components in order, less
    than the mean head's size of detail."""
    basis = shipped_displacement()
    count = len(basis.mean)
    assert basis.components.shape[1] == count
    beyond = {VERTEX_REGIONS[k] for k in np.unique(head.vertex_region[count:])}
    assert beyond == {"teeth", "mouth"} and len(head.neutral) - count < 0.1 * count
    assert 0.05 < np.abs(basis.mean).max() < 1
    size = np.linalg.norm(basis.components, axis=1)
    assert (np.diff(size) <= 1e-3 * size[0]).all() and size[0] / np.sqrt(count) < 0.2
    balls = np.any(eyeballs(head), axis=0)[:count]
    assert balls.any() and not basis.mean[balls].any() and not basis.components[:, balls].any()
    apart = np.column_stack([head.neutral[:count], 100 * balls])
    mirror = KDTree(apart).query(apart * (-1, 1, 1, 1))[1]
    # Its own mirror image before the lips were sealed.
    assert np.abs(basis.mean - basis.mean[mirror]).max() < 0.03
    assert np.percentile(np.abs(basis.mean - basis.mean[mirror]), 99) < 0.002
