"""The pinhole camera, and with it the project's one coordinate convention.

World frame = camera frame: right-handed, x right, y up, the camera at the origin looking along
-z, centimetres. What the camera sees has z < 0. Light directions are unit vectors in this frame.
Environment maps use it too: row v and column u of a latitude-longitude map hold the direction

    d = (sin(phi) sin(theta), cos(theta), -cos(phi) sin(theta)),  phi = 2 pi u, theta = pi v,

so the map's centre is the direction +z, from the face back to the camera: frontal light.

Image frame: x right, y down, in pixels; the centre of the pixel in row i and column j is
(j + 0.5, i + 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Camera:
    """Pinhole camera with square pixels.

    width, height: film size in pixels.
    focal: focal length in pixels.
    cx, cy: principal point in pixels (image frame); off centre for a crop of a photo.
    """

    width: int
    height: int
    focal: float
    cx: float
    cy: float

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project world points (..., 3), cm, z < 0, to pixels (..., 2) of the image frame."""
        points = np.asarray(points)
        scale = self.focal / -points[..., 2]
        return np.stack(
            [self.cx + points[..., 0] * scale, self.cy - points[..., 1] * scale], axis=-1
        )

    def unproject(self, pixels: np.ndarray, depth: np.ndarray | float) -> np.ndarray:
        """World points (..., 3) that project to `pixels` (..., 2) at `depth` = -z (cm, > 0)."""
        pixels = np.asarray(pixels, dtype=np.float64)
        depth = np.broadcast_to(np.asarray(depth, dtype=np.float64), pixels.shape[:-1])
        x = (pixels[..., 0] - self.cx) / self.focal * depth
        y = -(pixels[..., 1] - self.cy) / self.focal * depth
        return np.stack([x, y, -depth], axis=-1)

    def directions(self) -> np.ndarray:
        """Unit ray directions (height, width, 3), float32, through the pixel centres."""
        ys, xs = np.mgrid[0 : self.height, 0 : self.width] + 0.5
        rays = self.unproject(np.stack([xs, ys], axis=-1), 1.0)
        return (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)

    def mitsuba_sensor(self, samples: int, filter_: str = "box") -> dict[str, Any]:
        """Mitsuba dictionary of this camera with `samples` per pixel.

        Mitsuba's cameras look along +z with +x to the left, hence the half turn about y.
        """
        from ..machine.runtime import mitsuba

        mi = mitsuba()
        fov_x = 2 * np.degrees(np.arctan(0.5 * self.width / self.focal))
        turn = mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0])
        return {
            "type": "perspective",
            "fov": float(fov_x),
            "fov_axis": "x",
            "principal_point_offset_x": float(0.5 - self.cx / self.width),
            "principal_point_offset_y": float(0.5 - self.cy / self.height),
            "near_clip": 0.1,
            "far_clip": 1e4,
            "to_world": turn,
            "film": {
                "type": "hdrfilm",
                "width": self.width,
                "height": self.height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": filter_},
            },
            "sampler": {"type": "independent", "sample_count": samples},
        }
