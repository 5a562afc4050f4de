"""The first step: find the face, cut it out, and segment it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..face.photo import FacePhoto
from ..perception.landmarks import DetectedFace, choose, find_faces
from ..perception.mask import painted
from ..perception.regions import segment
from ..photo.crop import Crop, face_crop
from ..photo.photo import Photo
from ..scene.camera import Camera

#: Distance of a face from the camera, cm, where the photo does not tell its focal length, and
#: the width of the crop there, cm: a portrait taken from a metre away.
PORTRAIT_DISTANCE = 100.0
CROP_WIDTH = 26.5


def observe(
    photo: Photo,
    resolution: int,
    face: str | int | DetectedFace = "only",
    camera: Camera | None = None,
    mask: np.ndarray | None = None,
) -> FacePhoto:
    """The face's crop, `resolution` pixels a side, its landmarks and regions.

    With `camera` the photo is taken as the crop itself, as seen by that camera. face: as for
    `choose`, or one that `find_faces` has found. mask: (H, W) of the photo's size, which the
    face's region is multiplied with. Raises FaceError.
    """
    found = face
    if not isinstance(found, DetectedFace):
        found = choose(find_faces(photo.encoded8()), found, photo.source)
    height, width = photo.pixels.shape[:2]
    if camera is None:
        crop = face_crop(found.landmarks, resolution, (width, height))
        camera = crop_camera(photo, crop)
    else:
        crop = Crop(np.eye(2, 3), camera.width)
    image = np.maximum(crop.image(photo.pixels), 0).astype(np.float32)
    xy = crop.points(found.landmarks[:, :2])
    landmarks = np.column_stack([xy, found.landmarks[:, 2] * crop.scale])
    regions = segment(image, landmarks, found.blendshapes, crop.inside(width, height))
    if mask is not None:
        regions = painted(regions, regions.face * crop.image(mask))
    name = Path(photo.source).name
    return FacePhoto(name, image, camera, crop, regions, landmarks, photo.white_luminance)


def crop_camera(photo: Photo, crop: Crop) -> Camera:
    """The photo's pinhole camera restricted to the crop; a portrait's where EXIF says nothing."""
    size = crop.resolution
    if photo.focal is None:
        return Camera(size, size, size * PORTRAIT_DISTANCE / CROP_WIDTH, size / 2, size / 2)
    height, width = photo.pixels.shape[:2]
    cx, cy = np.asarray(crop.points(np.array([[width / 2, height / 2]])))[0]
    return Camera(size, size, photo.focal * crop.scale, float(cx), float(cy))
