"""What the landmarker gets wrong on average, as a function of the head's turn.

It sees less turn than there is, and draws the outline where the cheek ends. This can be measured
without any photo of a person: heads of the default model with random shape, expression, turn, skin
and light are photographed by path tracing, the landmarker is run, and its points are compared with
where the model carries them (tools/simulated_errors.py). A polynomial in yaw and pitch describes
the mean.

Errors are centimetres at the head's distance, x to the right and y down in the picture once the
head's roll is undone.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources

import numpy as np

from .model import LANDMARKS

FILE = "landmark_error.npz"
# Radians: beyond what was simulated the error is taken to be that of the limit.
_YAW, _PITCH = 0.75, 0.35
_RIDGE = 1.0


@dataclass(frozen=True)
class LandmarkError:
    """mean: (7, 956) coefficients of the terms of `_terms`, for x and y of the 478 points."""

    mean: np.ndarray

    def expected(self, yaw: float, pitch: float) -> np.ndarray:
        """(478, 2): mean of detected minus true for a head turned by these angles, radians."""
        angles = np.clip([yaw], -_YAW, _YAW), np.clip([pitch], -_PITCH, _PITCH)
        return (_terms(*angles) @ self.mean).reshape(LANDMARKS, 2)


#: Of landmarks that are right on average.
NO_ERROR = LandmarkError(np.zeros((7, 2 * LANDMARKS)))


def learn(
    errors: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, mirror: np.ndarray
) -> LandmarkError:
    """The error's mean from N examples, by least squares with a little damping.

    errors: (N, 478, 2) detected minus true, cm, roll undone. yaw, pitch: (N,) radians.
    mirror: (478,) each point's partner: a mirrored photo is an example, too.
    """
    errors = np.concatenate([errors, errors[:, mirror] * (-1, 1)])
    flat = errors.reshape(len(errors), -1)
    terms = _terms(np.concatenate([yaw, -yaw]), np.concatenate([pitch, pitch]))
    size = np.maximum(terms.std(axis=0), 1e-9)
    size[0] = 1
    scaled = terms / size
    ridge = np.diag([0.0, *np.full(terms.shape[1] - 1, _RIDGE)])
    return LandmarkError(
        np.linalg.solve(scaled.T @ scaled + ridge, scaled.T @ flat) / size[:, None]
    )


def _terms(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """(N, 7) polynomial terms of the angles."""
    one = np.ones_like(yaw)
    return np.stack([one, yaw, yaw**2, pitch, pitch**2, yaw * pitch, yaw**3], axis=1)


@functools.cache
def shipped_error() -> LandmarkError:
    """The error that comes with the package; simulated_errors.py makes it."""
    file = resources.files("unlit.head").joinpath(FILE)
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        return LandmarkError(arrays["mean"].astype(np.float64))
