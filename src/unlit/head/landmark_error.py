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
from pathlib import Path

import numpy as np

from .model import LANDMARKS

FILE = Path(__file__).with_name("landmark_error.npz")
# Radians: beyond what was simulated the error is taken to be that of the limit.
_YAW, _PITCH = 0.75, 0.35


@dataclass(frozen=True)
class LandmarkError:
    """mean: (7, 956) coefficients of the terms of `terms`, for x and y of the 478 points."""

    mean: np.ndarray

    def expected(self, yaw: float, pitch: float) -> np.ndarray:
        """(478, 2): mean of detected minus true for a head turned by these angles, radians."""
        angles = np.clip([yaw], -_YAW, _YAW), np.clip([pitch], -_PITCH, _PITCH)
        return (terms(*angles) @ self.mean).reshape(LANDMARKS, 2)


#: Of landmarks that are right on average.
NO_ERROR = LandmarkError(np.zeros((7, 2 * LANDMARKS)))


def terms(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """(N, 7) polynomial terms of the angles."""
    one = np.ones_like(yaw)
    return np.stack([one, yaw, yaw**2, pitch, pitch**2, yaw * pitch, yaw**3], axis=1)


@functools.cache
def shipped_error() -> LandmarkError:
    """The error that comes with the package; simulated_errors.py makes it."""
    with np.load(FILE, allow_pickle=False) as arrays:
        return LandmarkError(arrays["mean"].astype(np.float64))
