"""Regions of the skin on the default head: where they are, smooth, the same left and right."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from unlit.head.model import LANDMARKS, VERTEX_REGIONS, HeadModel
from unlit.head.skin_regions import SKIN_REGIONS, SMOOTHNESS, skin_regions
from unlit.scene.surface_points import SurfacePoints

#: Landmarks in the middle of a region.
MIDDLES = {
    "forehead": (151, 108, 337, 69, 299),
    "nose": (4, 5, 195, 197),
    "cheeks": (50, 280, 205, 425, 187, 411),
    "lids": (159, 386, 28, 258),
    "chin": (199, 200, 18),
    "upper_lip": (164, 167, 393),
}


@pytest.fixture(scope="module")
def weights(head: HeadModel) -> np.ndarray:
    found = skin_regions(head)
    assert found is not None
    return found


def test_weights_are_shares(head, weights):
    assert weights.shape == (len(head.neutral), len(SKIN_REGIONS))
    assert weights.dtype == np.float32 and weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("name", MIDDLES)
def test_a_region_is_where_its_name_says(head, weights, name):
    at = SurfacePoints(
        head.landmark_points.triangle[list(MIDDLES[name])],
        head.landmark_points.barycentric[list(MIDDLES[name])],
    ).on(weights, head.triangles)
    assert at[:, SKIN_REGIONS.index(name)].min() > 0.7


def test_ears_neck_and_scalp_are_the_models(head, weights):
    for part, name, least in (("ears", "ears", 0.9), ("scalp", "rest", 0.9), ("neck", "rest", 0.9)):
        of = head.vertex_region == VERTEX_REGIONS.index(part)
        assert weights[of, SKIN_REGIONS.index(name)].mean() > least


def test_no_edge_is_sharp(head, weights):
    """Per cm at most twice what a step has that a Gaussian of the smoothness has blurred."""
    sides = head.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    sides = sides[(head.vertex_region[sides] == VERTEX_REGIONS.index("skin")).all(axis=1)]
    length = np.linalg.norm(head.neutral[sides[:, 0]] - head.neutral[sides[:, 1]], axis=1)
    slope = np.abs(weights[sides[:, 0]] - weights[sides[:, 1]]).max(axis=1)
    assert (slope / np.maximum(length, 0.1)).max() < 2 / (SMOOTHNESS * np.sqrt(2 * np.pi))


def test_left_is_as_right(head, weights):
    distance, twin = KDTree(head.neutral).query(head.neutral * (-1, 1, 1))
    assert distance.max() < 0.1
    differs = np.abs(weights - weights[twin]).max(axis=1)
    assert np.percentile(differs, 98) < 0.05
    assert differs.mean() < 0.005


def test_a_model_without_landmarks_has_none(head):
    assert skin_regions(replace(head, landmark_points=SurfacePoints.empty(LANDMARKS))) is None
