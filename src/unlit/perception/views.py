"""Square views of a photo for the networks: any similarity, filtered when it shrinks."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class Square:
    """A rotated square in the photo, pixels of the image frame of `scene/camera.py`.

    x, y: centre. side: length in pixels. angle: radians, clockwise as seen on the screen, by
    which the square's horizontal axis is turned against the photo's.
    """

    x: float
    y: float
    side: float
    angle: float

    def to_photo(self, points: np.ndarray) -> np.ndarray:
        """Photo pixels (..., 2) of points (..., 2) given in units of the side, [0, 1]."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        turn = self.side * np.array([[cos, sin], [-sin, cos]])
        return (np.asarray(points) - 0.5) @ turn + (self.x, self.y)


class Pyramid:
    """A photo and its successive halvings, so that views of any size are free of aliasing."""

    def __init__(self, rgb: np.ndarray) -> None:
        """rgb: (H, W, 3) uint8."""
        self.height, self.width = rgb.shape[:2]
        self._levels = [rgb]

    def _level(self, index: int) -> np.ndarray:
        while len(self._levels) <= index:
            last = self._levels[-1]
            size = (max(1, last.shape[1] // 2), max(1, last.shape[0] // 2))
            self._levels.append(cv2.resize(last, size, interpolation=cv2.INTER_AREA))
        return self._levels[index]

    def view(self, square: Square, resolution: int) -> np.ndarray:
        """The square resampled to (resolution, resolution, 3) uint8; black outside the photo."""
        halvings = int(max(0.0, np.floor(np.log2(square.side / resolution))))
        image = self._level(halvings)
        level_scale = np.array([image.shape[1] / self.width, image.shape[0] / self.height])
        # Columns: images of the view's origin and unit steps, in pixels of the level.
        corners = square.to_photo(np.array([[0, 0], [1, 0], [0, 1]])) * level_scale
        matrix = np.stack(
            [
                (corners[1] - corners[0]) / resolution,
                (corners[2] - corners[0]) / resolution,
                corners[0],
            ],
            axis=1,
        )
        # OpenCV puts pixel centres on integers, the image frame half a pixel further.
        matrix[:, 2] += matrix[:, :2] @ (0.5, 0.5) - 0.5
        return cv2.warpAffine(
            image,
            matrix,
            (resolution, resolution),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
        )
