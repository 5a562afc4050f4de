"""What the optimisation may use of the photo, at the crop's resolution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..face.conditions import Conditions
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..perception.measures import face_area
from ..perception.regions import REGIONS
from ..scene.camera import Camera
from ..scene.surface_points import SurfacePoints


@dataclass(frozen=True)
class Observation:
    """What is known before the stages, as NumPy arrays.

    image: (H, W, 3) float32 linear sRGB, as under white light. regions: (H, W, 5) soft masks in
    [0, 1] of REGIONS. mask: (H, W) bool, the pixels that get maps. weight:
    (H, W) in [0, 1], how far the photo counts there. fitted: (H, W) bool, where landmarks hold the
    fitted head: of ears, neck, teeth and tongue neither place nor shape is as well known, so that
    light and gain are not judged there. camera: H x W pixels. vertices: (V, 3) float32 fitted mesh,
    world frame, cm; triangles: (F, 3) int32. landmarks: (L, 2) detected points, pixels of the
    image; landmark_points: the same points on the mesh. sun: (3,) direction of a light whose shadow
    the image has no more; None without one. skin_regions: (V, 8) as in FittedHead.
    """

    image: np.ndarray
    regions: np.ndarray
    mask: np.ndarray
    weight: np.ndarray
    fitted: np.ndarray
    camera: Camera
    vertices: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    landmark_points: SurfacePoints
    sun: np.ndarray | None = None
    skin_regions: np.ndarray | None = None

    def reduced(self, size: int) -> Observation:
        """The same at `size` pixels a side, if it is larger."""
        camera = self.camera
        if camera.width <= size:
            return self
        scale = size / camera.width

        def small(image: np.ndarray) -> np.ndarray:
            whole = np.atleast_3d(image).astype(np.float32)
            channels = [
                cv2.resize(channel, (size, size), interpolation=cv2.INTER_AREA)
                for channel in cv2.split(whole)
            ]
            return np.dstack(channels).reshape(size, size, *image.shape[2:])

        return replace(
            self,
            image=small(self.image),
            regions=small(self.regions),
            mask=small(self.mask) > 0.5,
            weight=small(self.weight),
            fitted=small(self.fitted) > 0.5,
            camera=Camera(size, size, camera.focal * scale, camera.cx * scale, camera.cy * scale),
            landmarks=self.landmarks * scale,
        )


def observation(photo: FacePhoto, head: FittedHead, conditions: Conditions) -> Observation:
    """The photo without the light's colour and the shadow, in which it counts less."""
    face, shadow = photo.regions.face, conditions.shadow
    return Observation(
        image=conditions.balanced(photo.image),
        regions=photo.regions.weights[..., : len(REGIONS)],
        mask=face > 0.5,
        weight=face if shadow is None else face * shadow.trust,
        fitted=face_area(photo.landmarks[:, :2], len(face)) & (photo.regions.mouth < 0.5),
        camera=photo.camera,
        vertices=head.mesh.vertices,
        triangles=head.mesh.triangles,
        landmarks=head.landmarks,
        landmark_points=head.landmark_points,
        sun=None if shadow is None else shadow.sun,
        skin_regions=head.skin_regions,
    )
