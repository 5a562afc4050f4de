"""Which of MakeHuman's shapes faces take: mean and covariance, learnt from another head model.

MakeHuman's targets are an artist's and say nothing about how common a shape is. ICT-FaceKit (USC
ICT Vision and Graphics Lab, MIT licence) is a statistical model made from scans. `main` draws
random identities from it, fits MakeHuman's axes to each of their surfaces, and keeps mean and
covariance of the coefficients. The fit is Gaussian, so its posterior covariance enters too: what a
surface does not tell about an axis stays as uncertain as the artist's standard deviation makes it.
What the axes cannot make of those surfaces is in learn_displacement.py.

    python tools/learn_prior.py ICT.npz    writes src/unlit/head/sources/makehuman_prior.npz

ICT.npz holds the model's `neutral` (V, 3) cm, `identity` (100, V, 3) of one standard deviation
each, `triangles` (F, 3) and `landmarks_multipie68` (68,) vertices, as in its public OBJ files.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from unlit.head.basis import on_rim
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.head.procrustes import procrustes
from unlit.head.sources.makehuman import ASSET, build, inner_product_weights
from unlit.head.sources.makehuman_learnt import PRIOR_FILE, shipped_landmarks
from unlit.machine.assets import asset
from unlit.perception.topology import MULTI_PIE_LANDMARKS
from unlit.scene.normals import vertex_normals

# The part of ICT's mesh that is skin: face, head and neck.
_ICT_SKIN = 11_248
_IDENTITIES = 100
_POINTS = 3000
# Standard deviations, cm: off the surface, along it, and of a common point; the surface counts as
# so many independent measurements, because neighbours err together.
_OFF, _ALONG, _COMMON_DEVIATION = 0.05, 0.5, 0.25
_INDEPENDENT = 400
_ITERATIONS = 6
# Part of the variance that a basis keeps.
_KEEP = 0.995
# Share of the hand-set covariance that is kept: ICT's people are not all people.
_ARTIST = 0.2


@dataclass(frozen=True)
class Surface:
    """A head to be fitted: points (N, 3), their unit normals, common points; any frame, cm.

    rim: (N,) bool, the points where the surface ends.
    """

    points: np.ndarray
    normals: np.ndarray
    common: np.ndarray
    rim: np.ndarray

    def moved(self, scale: float, rotation: np.ndarray, shift: np.ndarray) -> Surface:
        """The surface seen from a frame that lies in this one at scale, rotation and shift."""
        return replace(
            self,
            points=(self.points - shift) @ rotation / scale,
            normals=self.normals @ rotation,
            common=(self.common - shift) @ rotation / scale,
        )


class Fitter:
    """Fits a model's identity to surfaces; weights: (V,) of its vertices, 0 where not fitted."""

    def __init__(self, model: HeadModel, weights: np.ndarray) -> None:
        skin = np.isin(
            model.vertex_region, [VERTEX_REGIONS.index(n) for n in ("skin", "lips", "eyebrows")]
        )
        skin |= model.vertex_region == VERTEX_REGIONS.index("scalp")
        chosen = np.random.default_rng(0).permutation(np.flatnonzero(skin))[:_POINTS]
        weight = weights[chosen] / weights[chosen].mean()
        self.weight = weight * _INDEPENDENT / len(chosen)
        self.neutral = model.neutral[chosen].astype(np.float64)
        self.basis = model.identity[:, chosen].astype(np.float64)
        common = list(MULTI_PIE_LANDMARKS.values())
        self.common = model.landmarks(model.neutral)[common].astype(np.float64)
        self.common_basis = np.stack([model.landmarks(axis)[common] for axis in model.identity])

    def fit(self, surface: Surface) -> tuple[np.ndarray, np.ndarray, Surface]:
        """Coefficients (I,), their posterior covariance (I, I) under the prior N(0, 1), and the
        surface in the model's frame."""
        count = len(self.basis)
        surface = surface.moved(*procrustes(self.common, surface.common))
        coefficients = np.zeros(count)
        matrix = np.eye(count)
        for iteration in range(_ITERATIONS):
            points = self.neutral + np.tensordot(coefficients, self.basis, axes=1)
            common = self.common + np.tensordot(coefficients, self.common_basis, axes=1)
            distance, nearest = KDTree(surface.points).query(points)
            normal = surface.normals[nearest]
            arm = points - surface.points[nearest]
            off = np.sum(arm * normal, axis=1)
            deviation = max(_OFF, 0.2 / (iteration + 1))
            near = distance < (1.0 if iteration < 2 else 0.5)
            huber = np.minimum(1, 3 * deviation / np.maximum(np.abs(off), 1e-9))
            moves = _motions(points, self.basis)  # (N, 3, 7 + I)
            rows = np.einsum("nx,nxk->nk", normal, moves)
            matrix, gradient = _normal_equations(
                rows, off, self.weight * near * huber / deviation**2
            )
            along = (moves - normal[:, :, None] * rows[:, None]).reshape(-1, rows.shape[1])
            slip = (arm - off[:, None] * normal).ravel()
            more = _normal_equations(along, slip, np.repeat(self.weight * near / _ALONG**2, 3))
            matrix, gradient = matrix + more[0], gradient + more[1]
            rows = _motions(common, self.common_basis).reshape(-1, rows.shape[1])
            error = (common - surface.common).ravel()
            more = _normal_equations(rows, error, np.full(len(rows), _COMMON_DEVIATION**-2))
            matrix, gradient = matrix + more[0], gradient + more[1]
            matrix[7:, 7:] += np.eye(count)
            gradient[7:] += coefficients
            step = -np.linalg.solve(matrix, gradient)
            coefficients = coefficients + step[7:]
            turn = Rotation.from_rotvec(step[3:6]).as_matrix()
            surface = surface.moved(1 + step[6], turn, step[:3])
        return coefficients, np.linalg.inv(matrix)[7:, 7:], surface


def _motions(points: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Derivatives (N, 3, 7 + I) of points (N, 3): shift, turn, growth, then the basis (I, N, 3)."""
    shift = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    turn = np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)
    return np.concatenate([shift, turn, points[..., None], basis.transpose(1, 2, 0)], axis=2)


def _normal_equations(
    rows: np.ndarray, error: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    return (rows * weight[:, None]).T @ rows, rows.T @ (weight * error)


def identities(ict: Path, count: int = _IDENTITIES) -> Iterator[Surface]:
    """The skin of `count` random identities, the same ones every time, of ICT.npz (see above)."""
    with np.load(ict, allow_pickle=False) as arrays:
        neutral = arrays["neutral"].astype(np.float64)
        identity = arrays["identity"].astype(np.float32)
        triangles = arrays["triangles"].astype(int)
        corners = arrays["landmarks_multipie68"].astype(int)[list(MULTI_PIE_LANDMARKS)]
    triangles = triangles[(triangles < _ICT_SKIN).all(axis=1)]
    rim = on_rim(triangles, _ICT_SKIN)
    rng = np.random.default_rng(1)
    for _ in range(count):
        drawn = rng.standard_normal(len(identity)).astype(np.float32)
        shape = neutral + np.tensordot(drawn, identity, axes=1)
        normals = vertex_normals(shape, triangles)[:_ICT_SKIN]
        yield Surface(shape[:_ICT_SKIN], normals, shape[corners], rim)


def learn(model: HeadModel, weights: np.ndarray, ict: Path) -> tuple[np.ndarray, np.ndarray]:
    """Mean (I,) and covariance (I, I) of the identity of `model` over random ICT identities."""
    fitter = Fitter(model, weights)
    fits = [fitter.fit(surface) for surface in identities(ict)]
    means = np.array([mean for mean, _, _ in fits])
    spread = np.cov(means.T, bias=True) + np.mean([fit[1] for fit in fits], axis=0)
    return means.mean(axis=0), spread


def principal_combinations(
    axes: np.ndarray, covariance: np.ndarray, weights: np.ndarray, keep: float
) -> np.ndarray:
    """Principal components of the shapes that `axes` (J, V, 3) make, as rows (I, J) over the axes.

    One unit along each is one standard deviation; the largest comes first.
    covariance: (J, J) of the axes' coefficients.  weights: (V,) of the inner product.
    keep: part of the variance to keep, in (0, 1].
    """
    size, directions = np.linalg.eigh(covariance)
    half = directions * np.sqrt(np.maximum(size, 0))
    root = axes.reshape(len(axes), -1) * np.sqrt(np.repeat(weights, 3))
    variance, turned = np.linalg.eigh(half.T @ (root @ root.T) @ half)
    variance, turned = variance[::-1], turned[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(variance) / variance.sum(), keep)) + 1
    return (half @ turned[:, :kept]).T


def unlearnt() -> tuple[HeadModel, np.ndarray, np.ndarray]:
    """The head with the artist's shapes and hand-set deviations, from which a prior is learnt.

    Also the axes (J, V, 3), float64, and the rows (I, J) that make the model's identity of them.
    """
    model, axes, weights = build(asset(ASSET), shipped_landmarks())
    rows = principal_combinations(axes, np.eye(len(axes)), weights, _KEEP)
    identity = np.tensordot(rows, axes, axes=1).astype(np.float32)
    return replace(model, identity=identity), axes, rows


def main(ict: Path) -> None:
    """Make the prior that is shipped."""
    model, axes, rows = unlearnt()
    weights = inner_product_weights(model.neutral, model.triangles, model.vertex_region)
    mean, covariance = learn(model, weights, ict)
    covariance = (1 - _ARTIST) * covariance + _ARTIST * np.eye(len(covariance))
    learnt = principal_combinations(axes, rows.T @ covariance @ rows, weights, _KEEP)
    np.savez_compressed(
        PRIOR_FILE,
        mean=(mean @ rows).astype(np.float32),
        combinations=learnt.astype(np.float32),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
