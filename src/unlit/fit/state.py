"""The unknowns of the fit, and how points of the model move with them in space and image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..scene.camera import Camera

#: The settings' distances are stated for a crop of this size, pixels.
STATED_RESOLUTION = 512


@dataclass(frozen=True)
class State:
    """The unknowns, float64.

    rotation (3, 3), translation (3,) cm: world = rotation @ model + translation.
    identity (I,), in standard deviations; expression (E,), in [0, 1].
    """

    rotation: np.ndarray
    translation: np.ndarray
    identity: np.ndarray
    expression: np.ndarray

    def moved(self, move: np.ndarray) -> State:
        """After a step: turn about the world's axes (3, radians), shift (3, cm), identity (I,),
        expression (E,), which is kept in [0, 1]."""
        units = len(self.identity)
        return State(
            Rotation.from_rotvec(move[:3]).as_matrix() @ self.rotation,
            self.translation + move[3:6],
            self.identity + move[6 : 6 + units],
            np.clip(self.expression + move[6 + units :], 0, 1),
        )

    def placed(self, local: np.ndarray) -> np.ndarray:
        """Points (N, 3), world frame, of points in the model frame."""
        return local @ self.rotation.T + self.translation

    def motion(self, local: np.ndarray, basis: np.ndarray) -> np.ndarray:
        """Motion (N, 3, 6 + M), world, cm, of points (N, 3), model frame, with a step's unknowns.

        basis: (M, N, 3), displacement of the points with identity and expression.
        """
        turned = local @ self.rotation.T
        turns = np.stack([np.cross(axis, turned) for axis in np.eye(3)], axis=-1)
        shifts = np.broadcast_to(np.eye(3), turns.shape)
        shapes = np.einsum("xy,mny->nxm", self.rotation, basis)
        return np.concatenate([turns, shifts, shapes], axis=2)


def carried(basis: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Displacements (M, N, 3) of points from those of the vertices (M, V, 3).

    corners: (N, 3), vertices around each point; weights: (N, 3), barycentric.
    """
    moved = np.zeros((len(basis), *corners.shape))
    for c in range(3):
        moved += weights[:, c, None] * basis[:, corners[:, c]]
    return moved


def camera_motion(camera: Camera, world: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Motion in the image (N, 2, K), pixels, of points (N, 3) that move by `moves` (N, 3, K)."""
    nearness = 1 / -world[:, 2, None]
    centred = camera.project(world) - (camera.cx, camera.cy)
    along_x = camera.focal * moves[:, 0] + centred[:, :1] * moves[:, 2]
    along_y = -camera.focal * moves[:, 1] + centred[:, 1:] * moves[:, 2]
    return np.stack([along_x * nearness, along_y * nearness], axis=1)
