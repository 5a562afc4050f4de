"""What the MakeHuman head lacks and was learnt for it, as shipped; tools/learn_*.py make the files.

MakeHuman's targets are an artist's: they say nothing about how common a shape is, and no mixture of
them makes the folds that faces have at lips, chin and eyes. Prior and displacement come from
identities of ICT-FaceKit (docs/geometry.md), the landmarks from pictures of the head.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...scene.surface_points import SurfacePoints

LANDMARKS_FILE = Path(__file__).with_name("makehuman_landmarks.npz")
PRIOR_FILE = Path(__file__).with_name("makehuman_prior.npz")
DISPLACEMENT_FILE = Path(__file__).with_name("makehuman_displacement.npz")


@dataclass(frozen=True)
class ShapePrior:
    """A Gaussian over the J axes of MakeHuman's identity, each in its own standard deviations.

    mean: (J,). combinations: (I, J): row i is one standard deviation along component i; the
    components are independent and the largest comes first. float32.
    """

    mean: np.ndarray
    combinations: np.ndarray


@dataclass(frozen=True)
class DisplacementBasis:
    """Displacements, cm, along the normals of the neutral head: a mean and principal components.

    mean: (V,). components: (K, V), each of one standard deviation, independent, the largest first.
    """

    mean: np.ndarray
    components: np.ndarray


def shipped_landmarks() -> SurfacePoints:
    """Where the 478 landmarks lie on the MakeHuman head."""
    arrays = _arrays(LANDMARKS_FILE)
    return SurfacePoints(arrays["triangle"], arrays["barycentric"])


def shipped_prior() -> ShapePrior:
    """Of the shape of faces in terms of MakeHuman's axes."""
    arrays = _arrays(PRIOR_FILE)
    return ShapePrior(arrays["mean"], arrays["combinations"])


def shipped_displacement() -> DisplacementBasis:
    """Of what MakeHuman's axes cannot make of faces, float32."""
    arrays = _arrays(DISPLACEMENT_FILE)
    return DisplacementBasis(
        arrays["mean"].astype(np.float32), arrays["components"].astype(np.float32)
    )


def _arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)
