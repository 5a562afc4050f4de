"""Learning the prior: the fit to a surface finds a known head, and what is shipped makes sense."""

from __future__ import annotations

import numpy as np
from learn_prior import Fitter, Surface, principal_combinations
from scipy.spatial.transform import Rotation

from unlit.head.model import HeadModel
from unlit.head.sources.makehuman import inner_product_weights
from unlit.head.sources.makehuman_learnt import shipped_displacement, shipped_prior
from unlit.perception.topology import MULTI_PIE_LANDMARKS
from unlit.scene.normals import vertex_normals


def test_basis_is_orthogonal_and_keeps_the_covariance() -> None:
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


def test_a_known_head_is_found_in_another_frame(head: HeadModel) -> None:
    """A moved, turned and scaled head of the model's own: its shape is found to a millimetre."""
    weights = inner_product_weights(head.neutral, head.triangles, head.vertex_region)
    fitter = Fitter(head, weights)
    truth = np.zeros(len(head.identity))
    truth[:5] = (2.0, -2.5, 1.8, 2.2, -1.9)
    shape = head.vertices(truth, np.zeros(len(head.expression))).astype(np.float64)
    turn = Rotation.from_euler("xyz", (10, -20, 5), degrees=True).as_matrix()
    placed = 1.1 * shape @ turn.T + (3, -2, 7)
    common = list(MULTI_PIE_LANDMARKS.values())
    surface = Surface(
        placed,
        vertex_normals(placed, head.triangles),
        head.landmarks(placed)[common],
        np.zeros(len(placed), dtype=bool),
    )
    found, covariance, seen = fitter.fit(surface)
    skin = head.vertex_region == 0
    off = np.tensordot(found - truth, head.identity[:, skin], axes=1)
    motion = np.tensordot(truth, head.identity[:, skin], axes=1)
    assert np.linalg.norm(off, axis=1).mean() < 0.1 < 0.3 < np.linalg.norm(motion, axis=1).mean()
    assert np.linalg.norm((seen.points - shape)[skin], axis=1).mean() < 0.1
    # Knowing the surface makes every direction more certain than the prior, none impossible.
    size = np.linalg.eigvalsh(covariance)
    assert size[0] > 0 and size[-1] < 1 + 1e-6 and size[0] < 0.05


def test_shipped_prior_moves_the_mean_by_millimetres(head: HeadModel) -> None:
    """A row per component before the displacements; the mean is no caricature."""
    prior = shipped_prior()
    components = len(head.identity) - len(shipped_displacement().components)
    assert prior.components.shape == (components, len(prior.mean))
    assert np.isfinite(prior.components).all() and np.isfinite(prior.mean).all()
    assert 0.1 < np.abs(prior.mean).max() < 5
