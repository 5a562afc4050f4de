"""What faces have that no mixture of MakeHuman's axes can make: displacements along its normals.

Fitted to a face, MakeHuman's axes leave a millimetre, and with it most of the error of the
normals: folds at lips, chin and eyes that only the artist's head has. `main` fits the learnt model
(learn_prior.py) to random identities of ICT-FaceKit (USC ICT Vision and Graphics Lab, MIT licence),
moves every vertex of its skin along the mean head's normal until it lies on the surface, as
smoothly as that goes, and keeps mean and principal components of the heights. Mirrored faces
count, too.

    python tools/learn_displacement.py ICT.npz

writes src/unlit/head/sources/makehuman_displacement.npz.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from learn_prior import Fitter, Surface, identities
from scipy.sparse.linalg import spsolve
from scipy.spatial import KDTree

from unlit.head.basis import vertex_areas
from unlit.head.contact import eyeballs
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.head.sources.makehuman import ASSET, build, inner_product_weights
from unlit.head.sources.makehuman_learnt import (
    DISPLACEMENT_FILE,
    Shapes,
    shipped_landmarks,
    shipped_prior,
)
from unlit.machine.assets import asset
from unlit.scene.normals import vertex_normals

# Components that are kept; docs/geometry.md has what more of them, or none, would give.
_COMPONENTS = 20
_ITERATIONS = 6
# A point of the surface is the one that is meant within this distance, cm, and cosine of normals.
_NEAR, _FACING = 0.4, 0.5
# So far from eyeballs and the inside of the mouth, cm, the surface counts: rims differ too much.
_RIM = 0.2
# Details smaller than this, cm, are not followed, first and last.
_DETAIL = (0.4, 0.2)
# Weight of no height where there is no skin, against the surface's where there is.
_ELSEWHERE = 0.01


class Registration:
    """Moves the vertices of a model's skin along the neutral head's normals onto surfaces."""

    def __init__(self, model: HeadModel) -> None:
        self.model = model
        region = model.vertex_region
        self.skin = np.isin(
            region, [VERTEX_REGIONS.index(name) for name in ("skin", "lips", "eyebrows")]
        )
        hollow = np.isin(region, [VERTEX_REGIONS.index(name) for name in ("eyes", "mouth")])
        away = KDTree(model.neutral[hollow]).query(model.neutral)[0] > _RIM
        self.measured = self.skin & away
        self.area = vertex_areas(model.neutral, model.triangles)
        self.normals = vertex_normals(model.neutral, model.triangles)
        self.roughness = _biharmonic(model.neutral, model.triangles, self.area)

    def heights(self, surface: Surface, coefficients: np.ndarray) -> np.ndarray:
        """Heights (V,), cm, over the head of `coefficients` (I,), for a surface in its frame."""
        model = self.model
        start = model.neutral + np.tensordot(coefficients, model.identity, axes=1)
        tree = KDTree(surface.points)
        heights = np.zeros(len(start))
        for iteration in range(_ITERATIONS):
            points = start + heights[:, None] * self.normals
            distance, nearest = tree.query(points)
            normal = surface.normals[nearest]
            facing = np.sum(vertex_normals(points, model.triangles) * normal, axis=1)
            off = np.sum((surface.points[nearest] - points) * normal, axis=1)
            off /= np.clip(np.sum(self.normals * normal, axis=1), 0.5, 1)
            on = self.measured & (distance < _NEAR) & (np.abs(off) < _NEAR)
            on = self.area * (on & (facing > _FACING) & ~surface.rim[nearest])
            detail = _DETAIL[iteration >= _ITERATIONS // 2]
            flat = _ELSEWHERE * self.area * ~self.skin
            matrix = sp.diags(on + flat) + detail**4 * self.roughness
            heights = np.asarray(spsolve(matrix.tocsc(), on * (heights + off)))
        return heights


def _biharmonic(vertices: np.ndarray, triangles: np.ndarray, area: np.ndarray) -> sp.csc_matrix:
    """(V, V) symmetric: h' M h is the integral of the squared Laplacian of h, 1 / cm^2.

    The umbrella over the mean squared length of its edges stands for the Laplacian.
    """
    count = len(vertices)
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    sides = np.unique(np.concatenate([sides, sides[:, ::-1]]), axis=0)
    squared = np.sum((vertices[sides[:, 0]] - vertices[sides[:, 1]]) ** 2, axis=1)
    degree = np.bincount(sides[:, 0], minlength=count)
    length2 = np.bincount(sides[:, 0], squared, minlength=count) / degree
    near = sp.csr_matrix((1 / degree[sides[:, 0]], sides.T), shape=(count, count))
    laplacian = sp.diags(4 / length2) @ (sp.identity(count) - near)
    return (laplacian.T @ sp.diags(area) @ laplacian).tocsc()


def learn(model: HeadModel, weights: np.ndarray, ict: Path) -> Shapes:
    """Of `model` over random ICT identities; weights as for Fitter."""
    fitter, registration = Fitter(model, weights), Registration(model)
    found = []
    for surface in identities(ict):
        coefficients, _, placed = fitter.fit(surface)
        found.append(registration.heights(placed, coefficients))
    heights = np.array(found)
    # Eyeballs stay spheres, and no vertex of theirs is a lid's mirror image.
    balls = np.any(eyeballs(model), axis=0)
    apart = np.column_stack([model.neutral, 100 * balls])
    mirror = KDTree(apart).query(apart * (-1, 1, 1, 1))[1]
    heights = np.concatenate([heights, heights[:, mirror]])
    heights[:, balls] = 0
    mean = heights.mean(axis=0)
    _, sizes, rows = np.linalg.svd(heights - mean, full_matrices=False)
    deviations = sizes[:_COMPONENTS] / np.sqrt(len(heights))
    return Shapes(mean, deviations[:, None] * rows[:_COMPONENTS])


def main(ict: Path) -> None:
    """Make the displacements that are shipped."""
    model = build(asset(ASSET), shipped_landmarks(), shipped_prior())[0]
    weights = inner_product_weights(model.neutral, model.triangles, model.vertex_region)
    found = learn(model, weights, ict)
    np.savez_compressed(
        DISPLACEMENT_FILE,
        mean=found.mean.astype(np.float16),
        components=found.components.astype(np.float16),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
