"""How shading at a pixel changes with the head model's pose and shape.

At a fixed pixel the normal changes because the surface turns and because another point of it comes
into view:

    dn(pixel) = dn(material point) - (dn / dpixel) u,        u: motion of that point in the image

Everything is linear in the model's basis, so the derivatives with respect to all unknowns come
from a few array products; visibility is held fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..head.model import HeadModel
from ..scene.camera import Camera
from .state import State, camera_motion, carried

#: Normals of neighbouring pixels that differ by more are of two surfaces, one behind the other.
_CREASE = 0.5


@dataclass(frozen=True)
class SeenPixels:
    """N of the pixels that show the mesh at `state`.

    local: (V, 3) vertices, model frame. pixel: (N,) row-major; triangle: (N,) seen there; weights:
    (N, 3) barycentric; position: (N, 3) world, cm. normals: (H, W, 3) of all pixels, world, 0 off
    the mesh.
    """

    state: State
    local: np.ndarray
    pixel: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray
    position: np.ndarray
    normals: np.ndarray


class ShapeJacobian:
    """Derivatives in the unknowns of `State.moved` for one model and camera."""

    def __init__(self, model: HeadModel, camera: Camera) -> None:
        self.camera, self.triangles, self.basis = camera, model.triangles, model.basis

    def rows(self, seen: SeenPixels, gradient: np.ndarray) -> np.ndarray:
        """d value / d unknowns (N, 6 + I + E) of the pixels' values.

        gradient: (N, 3) of the value with respect to the unit normal, world frame.
        """
        inverse, weights = seen.state.rotation, seen.weights
        corner, unit, turning = self._vertex_normals(seen.local, seen.triangle)
        normal = np.einsum("pc,pcx->px", weights, unit[corner])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal /= length
        pull = gradient @ inverse  # into the model frame
        pull = (pull - normal * np.sum(pull * normal, axis=1, keepdims=True)) / length
        by_shape = sum(
            weights[:, c, None] * np.einsum("px,pmx->pm", pull, turning[corner[:, c]])
            for c in range(3)
        )
        by_turn = np.cross(normal @ inverse.T, gradient)
        material = np.concatenate([by_turn, np.zeros((len(corner), 3)), by_shape], axis=1)
        motion = camera_motion(self.camera, seen.position, self._moves(seen))
        slope_x, slope_y = (_image_slope(seen.normals, seen.pixel, axis) for axis in (1, 0))
        slide_x, slide_y = (np.sum(gradient * s, axis=1)[:, None] for s in (slope_x, slope_y))
        return material - slide_x * motion[:, 0] - slide_y * motion[:, 1]

    def _vertex_normals(
        self, local: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corners (N, 3) as rows of the U vertices used, their normals, and derivatives (U, M, 3).

        The normals are unit vectors, the mean of the triangles around a vertex by area.
        """
        used, corner = np.unique(self.triangles[triangle], return_inverse=True)
        row = np.full(len(local), -1)
        row[used] = np.arange(len(used))
        around = self.triangles[(row[self.triangles] >= 0).any(axis=1)]
        a, b, c = (local[around[:, k]] for k in range(3))
        da, db, dc = (self.basis[:, around[:, k]] for k in range(3))
        face = np.cross(b - a, c - a)
        turning = np.cross(db - da, c - a) + np.cross(b - a, dc - da)  # (M, F, 3)
        target = row[around]
        kept = target >= 0
        faces = np.broadcast_to(np.arange(len(around))[:, None], target.shape)[kept]
        shape = (len(used), len(around))
        total = sp.csr_matrix((np.ones(len(faces), np.float32), (target[kept], faces)), shape)
        normal = total @ face
        flat = np.ascontiguousarray(turning.transpose(1, 0, 2)).reshape(len(around), -1)
        change = (total @ flat).reshape(len(used), -1, 3)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal /= length
        radial = np.einsum("ux,umx->um", normal, change)
        change = (change - normal[:, None] * radial[..., None]) / length[:, None]
        return corner.reshape(-1, 3), normal, change

    def _moves(self, seen: SeenPixels) -> np.ndarray:
        """Motion (N, 3, 6 + M), world, cm, of the material points that are seen."""
        corners, state = self.triangles[seen.triangle], seen.state
        basis = carried(self.basis, corners, seen.weights)
        return state.motion((seen.position - state.translation) @ state.rotation, basis)


def _image_slope(normals: np.ndarray, pixel: np.ndarray, axis: int) -> np.ndarray:
    """Central difference (N, 3) at `pixel` (N,), row-major and not at the border, of the normals
    (H, W, 3) along an image axis; 0 across a fold or an edge.
    """
    flat, step = normals.reshape(-1, 3), (normals.shape[1], 1)[axis]
    slope = 0.5 * (flat[pixel + step] - flat[pixel - step])
    return np.where(np.linalg.norm(slope, axis=1, keepdims=True) > _CREASE, 0, slope)
