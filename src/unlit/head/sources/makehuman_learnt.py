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
class Shapes:
    """A Gaussian over N numbers that make a shape, float32.

    mean: (N,). components: (K, N), each of one standard deviation, independent, the largest first.
    """

    mean: np.ndarray
    components: np.ndarray


def shipped_landmarks() -> SurfacePoints:
    """Where the 478 landmarks lie on the MakeHuman head."""
    arrays = _arrays(LANDMARKS_FILE)
    return SurfacePoints(arrays["triangle"], arrays["barycentric"])


def shipped_prior() -> Shapes:
    """Of faces: amounts of MakeHuman's axes of identity, each in its own standard deviations."""
    arrays = _arrays(PRIOR_FILE)
    return Shapes(arrays["mean"], arrays["combinations"])


def shipped_displacement() -> Shapes:
    """Of what these axes cannot make of faces: cm along the normals of the neutral's vertices."""
    arrays = _arrays(DISPLACEMENT_FILE)
    return Shapes(arrays["mean"].astype(np.float32), arrays["components"].astype(np.float32))


def _arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)
