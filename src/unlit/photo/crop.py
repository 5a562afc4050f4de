"""The square of the photo that the face fills, and the way there and back.

`face_crop` frames the face; `Crop` maps pixels and points. Image frame: see photo.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from ..errors import FaceError

# The face oval's height as a part of the crop's side, and how far the crop's centre lies above
# the oval's in oval heights: the landmarks end a little below the hairline.
_OVAL_HEIGHT = 0.70
_FOREHEAD_SHIFT = 0.04


@dataclass(frozen=True)
class Crop:
    """An upright square of the photo, resampled to `resolution` pixels a side.

    matrix: (2, 3) float64, photo pixels to crop pixels (image frame): one scale for both axes,
        and a shift.
    resolution: pixels a side.
    """

    matrix: np.ndarray
    resolution: int

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, dtype=np.float64)
        if matrix.shape != (2, 3) or not np.array_equal(matrix[:, :2], matrix[0, 0] * np.eye(2)):
            raise ValueError("a crop is upright and square: matrix must be scale and shift only")
        if not (np.isfinite(matrix).all() and matrix[0, 0] > 0 and self.resolution > 0):
            raise ValueError("a crop's scale and resolution must be positive")
        object.__setattr__(self, "matrix", matrix)

    @property
    def scale(self) -> float:
        """Crop pixels a photo pixel; a focal length in photo pixels is multiplied by it."""
        return float(self.matrix[0, 0])

    @property
    def origin(self) -> np.ndarray:
        """Upper left corner (x, y) of the square in photo pixels; may lie outside the photo."""
        return -self.matrix[:, 2] / self.scale

    def points(self, xy: Any) -> np.ndarray:
        """Points (..., 2) of the photo, in pixels, to crop pixels, float64."""
        return np.asarray(xy, dtype=np.float64) * self.scale + self.matrix[:, 2]

    def inverse_points(self, xy: Any) -> np.ndarray:
        """Points (..., 2) of the crop, in pixels, to photo pixels, float64."""
        return (np.asarray(xy, dtype=np.float64) - self.matrix[:, 2]) / self.scale

    def image(self, photo: np.ndarray) -> np.ndarray:
        """Crop `photo` (H, W, C) or (H, W), linear values, to (S, S, C) or (S, S) float32.

        Beyond the photo its edge is repeated. A crop pixel is the mean over its own area of the
        photo, or over the area of one photo pixel where that is larger, so that reducing does not
        alias and enlarging interpolates linearly. Means are taken in linear light.
        """
        (x0, y0), step = self.origin, 1 / self.scale
        rows = _means(self.resolution, y0, step, photo.shape[0])
        columns = _means(self.resolution, x0, step, photo.shape[1])
        return _resample(photo, rows, columns)

    def inside(self, width: int, height: int) -> np.ndarray:
        """(S, S) bool: the crop's pixels whose centres lie in a photo of that size."""
        side = np.arange(self.resolution) + 0.5
        x, y = self.inverse_points(np.stack([side, side], axis=1)).T
        return ((y >= 0) & (y <= height))[:, None] & ((x >= 0) & (x <= width))

    def paste(self, crop: np.ndarray, photo: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Put a crop back: a copy of `photo` (H, W, C) with `crop` (S, S, C) blended in.

        mask: (S, S) in [0, 1], 1 where the crop replaces the photo. Crop and mask are resampled
        to the photo's pixels; photo pixels with their centres outside the square stay as they are.
        """
        low = np.maximum(np.ceil(self.origin - 0.5), 0).astype(int)
        end = self.origin + self.resolution / self.scale
        size = np.array([photo.shape[1], photo.shape[0]])
        high = np.maximum(np.minimum(np.ceil(end - 0.5).astype(int), size), low)
        out = np.array(photo, dtype=np.float32)
        if (high == low).any():
            return out
        # Pixel j of the window covers [start + j scale, start + (j + 1) scale] of the crop.
        start = self.points(low)
        rows = _means(high[1] - low[1], start[1], self.scale, self.resolution)
        columns = _means(high[0] - low[0], start[0], self.scale, self.resolution)
        window = out[low[1] : high[1], low[0] : high[0]]
        weight = _resample(mask, rows, columns)[..., None]
        window += weight * (_resample(crop, rows, columns) - window)
        return out


def _means(count: int, start: float, step: float, size: int) -> sparse.csr_array:
    """Weights (count, size) that average `size` pixels over `count` intervals in a row.

    Interval i is [start + i step, start + (i + 1) step], widened about its centre to one pixel
    if it is shorter. What lies outside [0, size] counts to the first or last pixel.
    """
    width = max(step, 1.0)
    low = start + (np.arange(count) + 0.5) * step - 0.5 * width
    first = np.floor(low).astype(np.int64)
    pixels = first[:, None] + np.arange(math.ceil(width) + 1)
    overlap = np.minimum(pixels + 1, low[:, None] + width) - np.maximum(pixels, low[:, None])
    weights = np.maximum(overlap, 0) / width
    index = (np.repeat(np.arange(count), pixels.shape[1]), np.clip(pixels, 0, size - 1).ravel())
    return sparse.csr_array((weights.ravel(), index), shape=(count, size), dtype=np.float32)


def _resample(image: np.ndarray, rows: sparse.csr_array, columns: sparse.csr_array) -> np.ndarray:
    """rows (h, H) times image (H, W[, C]) times columns (w, W) transposed: (h, w[, C]) float32."""
    used = np.unique(rows.indices)
    near = slice(used[0], used[-1] + 1)
    part = np.asarray(image[near], dtype=np.float32)
    channels = part.shape[2:]
    lines: np.ndarray = rows[:, near] @ part.reshape(len(part), -1)  # (h, W C)
    lines = lines.reshape(len(lines), image.shape[1], -1).swapaxes(0, 1)  # (W, h, C)
    out: np.ndarray = columns @ lines.reshape(image.shape[1], -1)  # (w, h C)
    out = out.reshape(len(out), lines.shape[1], -1).swapaxes(0, 1)  # (h, w, C)
    return np.ascontiguousarray(out.reshape(*out.shape[:2], *channels))


def face_crop(landmarks: np.ndarray, resolution: int, size: tuple[int, int]) -> Crop:
    """Frame a face: an upright square around it, from hairline to chin with a margin.

    landmarks: (478, 2 or more) photo pixels.  resolution: pixels a side of the crop.
    size: (width, height) of the photo, beyond which the square may reach.

    The landmarks' extent (the face oval; with the head turned aside, its larger side) takes 70 %
    of the square. Raises FaceError if more than half of the landmarks lie outside the photo.
    """
    xy = np.asarray(landmarks, dtype=np.float64)[:, :2]
    inside = ((xy >= 0) & (xy <= np.asarray(size))).all(axis=1)
    if inside.mean() < 0.5:
        raise FaceError("more than half of the face lies outside the photo; choose another photo")
    low, high = xy.min(axis=0), xy.max(axis=0)
    extent = (high - low).max()
    centre = (low + high) / 2 - (0, _FOREHEAD_SHIFT * extent)
    scale = resolution * _OVAL_HEIGHT / extent
    shift = resolution / 2 - scale * centre
    return Crop(np.array([[scale, 0, shift[0]], [0, scale, shift[1]]]), resolution)
