"""Aligning points: a known similarity is found, and never a mirror image."""

import numpy as np
from scipy.spatial.transform import Rotation

from unlit.head.procrustes import procrustes


def test_a_known_similarity_is_found() -> None:
    """Scale, rotation and shift come back."""
    source = np.random.default_rng(0).normal(size=(12, 3))
    turn = Rotation.from_euler("xyz", (40, -70, 110), degrees=True).as_matrix()
    scale, rotation, shift = procrustes(source, 2.5 * source @ turn.T + (1, -2, 30))
    np.testing.assert_allclose(scale, 2.5)
    np.testing.assert_allclose(rotation, turn, atol=1e-12)
    np.testing.assert_allclose(shift, (1, -2, 30))


def test_a_mirror_image_is_not_mirrored() -> None:
    """The best rotation is a rotation, even where a reflection would fit exactly."""
    source = np.random.default_rng(1).normal(size=(12, 3))
    rotation = procrustes(source, source * (-1, 1, 1))[1]
    np.testing.assert_allclose(np.linalg.det(rotation), 1)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
