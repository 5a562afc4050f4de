"""Learn the landmarker's mean error from examples; tools/simulated_errors.py makes those."""

from __future__ import annotations

import numpy as np

from ..landmark_error import LandmarkError, terms

_RIDGE = 1.0


def learn(
    errors: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, mirror: np.ndarray
) -> LandmarkError:
    """The error's mean from N examples, by least squares with a little damping.

    errors: (N, 478, 2) detected minus true, cm, roll undone. yaw, pitch: (N,) radians.
    mirror: (478,) each point's partner: a mirrored photo is an example, too.
    """
    errors = np.concatenate([errors, errors[:, mirror] * (-1, 1)])
    flat = errors.reshape(len(errors), -1)
    rows = terms(np.concatenate([yaw, -yaw]), np.concatenate([pitch, pitch]))
    size = np.maximum(rows.std(axis=0), 1e-9)
    size[0] = 1
    scaled = rows / size
    ridge = np.diag([0.0, *np.full(rows.shape[1] - 1, _RIDGE)])
    return LandmarkError(
        np.linalg.solve(scaled.T @ scaled + ridge, scaled.T @ flat) / size[:, None]
    )
