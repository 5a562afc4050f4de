"""A height over the surface, in the crop's pixels, and the bent normals that it makes.

Where the surface is moved by h along its unit normal n, its normal turns, to first order, to
n - grad h: the perturbation e = -grad h. A perturbation that was found pixel by pixel need not be a
gradient; the height is the one whose gradient is nearest in weighted least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import cg
from threadpoolctl import threadpool_limits

from .camera import Camera

#: Surfaces that are seen more obliquely than this cosine are taken to be seen so.
_OBLIQUE = 0.2
#: Grazing surfaces hold few pixels, and errors of theirs are long slopes: the cosines between which
#: trust grows to 1.
_GRAZING = (0.15, 0.5)
_TOLERANCE, _ITERATIONS = 1e-3, 500


@dataclass(frozen=True)
class PixelFrames:
    """The tangent plane behind each of P pixels.

    pixel: (P,) row-major, of an image of `width` x `height` pixels. across, down: (P, 3) cm, how
    the point on the plane moves from a pixel to the next one to the right, and below. facing: (P,)
    cosine between the normal and the way to the camera.
    """

    pixel: np.ndarray
    width: int
    height: int
    across: np.ndarray
    down: np.ndarray
    facing: np.ndarray

    @staticmethod
    def of(
        camera: Camera, pixel: np.ndarray, position: np.ndarray, normal: np.ndarray
    ) -> PixelFrames:
        """Of points `position` (P, 3), world frame, cm, with unit normals (P, 3)."""
        depth = -position[:, 2:]
        ray = position / depth
        away = (ray * normal).sum(axis=1)
        length = np.linalg.norm(ray, axis=1)
        facing = np.clip(-away / length, 0, 1)
        away = -length * np.maximum(facing, _OBLIQUE)
        steps = []
        for axis, sign in ((0, 1.0), (1, -1.0)):
            step = np.zeros_like(ray)
            step[:, axis] = sign / camera.focal
            along = sign / camera.focal * normal[:, axis] / away
            steps.append((depth * (step - ray * along[:, None])).astype(np.float32))
        across, down = steps
        size = (camera.width, camera.height)
        return PixelFrames(pixel, *size, across, down, facing.astype(np.float32))

    @property
    def trust(self) -> np.ndarray:
        """(P,) in [0, 1]: how far slopes are told where a surface is seen as obliquely as here."""
        low, high = _GRAZING
        return np.asarray(np.clip((self.facing - low) / (high - low), 0, 1))

    @cached_property
    def _following(self) -> tuple[np.ndarray, np.ndarray]:
        """(P,) each: which of the pixels is to the right, and below; -1 where there is none."""
        lookup = np.full(self.width * (self.height + 1), -1, np.int64)
        lookup[self.pixel] = np.arange(len(self.pixel))
        last = self.pixel % self.width == self.width - 1
        return np.where(last, -1, lookup[self.pixel + 1]), lookup[self.pixel + self.width]

    def height_of(
        self, perturbation: np.ndarray, weight: np.ndarray, flatness: float | np.ndarray = 1e-3
    ) -> np.ndarray:
        """The height (P,), cm, whose perturbation is nearest to `perturbation` (P, 3).

        weight: (P,) >= 0, of each pixel's slopes. flatness: what the square of a height costs
        against that of its difference from pixel to pixel, > 0; of all pixels, or of each (P,).
        """
        count = len(self.pixel)
        matrix = sparse.diags(np.broadcast_to(flatness, count), format="csr")
        wanted = np.zeros(count)
        for following, step in zip(self._following, (self.across, self.down), strict=True):
            own = np.flatnonzero(following >= 0)
            other = following[own]
            slope = -(perturbation * step).sum(axis=1)
            between = (slope[own] + slope[other]) / 2
            share = (weight[own] + weight[other]) / 2
            each = np.arange(len(own))
            difference = sparse.csr_matrix(
                (
                    np.repeat([1.0, -1.0], len(own)),
                    (np.concatenate([each, each]), np.concatenate([other, own])),
                ),
                (len(own), count),
            )
            matrix = matrix + difference.T @ sparse.diags(share) @ difference
            wanted += difference.T @ (share * between)
        start = sparse.diags(1 / matrix.diagonal())
        # Its products are short: threads of a BLAS wait for each other, up to ten times as long.
        with threadpool_limits(1, user_api="blas"):
            found, _ = cg(matrix, wanted, rtol=_TOLERANCE, maxiter=_ITERATIONS, M=start)
        return np.asarray(found, np.float32)

    def perturbation_of(self, height: np.ndarray) -> np.ndarray:
        """e = -grad h, (P, 3), of a height (P,) in cm."""
        slopes = []
        for following in self._following:
            own = np.flatnonzero(following >= 0)
            other = following[own]
            rise = height[other] - height[own]
            total, sides = np.zeros(len(height)), np.zeros(len(height))
            for at in (own, other):  # the mean of the differences on both sides
                total[at] += rise
                sides[at] += 1
            slopes.append(total / np.maximum(sides, 1))
        pairs = ((self.across, self.across), (self.across, self.down), (self.down, self.down))
        a, b, c = ((x * y).sum(axis=1) for x, y in pairs)
        area = np.maximum(a * c - b * b, 1e-12)
        along = (c * slopes[0] - b * slopes[1]) / area
        below = (a * slopes[1] - b * slopes[0]) / area
        gradient = along[:, None] * self.across + below[:, None] * self.down
        return np.asarray(-gradient, np.float32)
