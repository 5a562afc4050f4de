"""What is behind a relit person: the photo as it is, a colour, a picture, or the new light."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from PIL import ImageColor

from ..color import decode_srgb
from ..errors import SettingsError
from ..face.reconstruction import Reconstruction
from ..photo.photo import Photo, read_photo
from ..scene.light import coloured
from .lights import turned

PHOTO, LIGHT = "photo", "light"

#: Of the degrees by which the light is turned, the (H, W, 3) linear sRGB behind the person; None
#: where the photo stays.
Background = Callable[[float], np.ndarray | None]


def colour_of(text: str) -> np.ndarray | None:
    """(3,) linear sRGB of a CSS colour ("#808080", "navy"); None if `text` is none.

    Raises SettingsError for one with an alpha.
    """
    try:
        encoded = ImageColor.getrgb(text)
    except ValueError:
        return None
    if len(encoded) > 3:
        raise SettingsError(
            f"{text}: a colour with an alpha; give an opaque one, such as '#808080'", "background"
        )
    return decode_srgb(np.array(encoded, np.float32) / 255)


def check_background(text: str) -> None:
    """Raise SettingsError if `text` names no background, before anything is read."""
    if text not in (PHOTO, LIGHT) and colour_of(text) is None and not Path(text).is_file():
        raise SettingsError(
            f"{text}: no such background; give photo, light, a colour such as '#808080' or navy, "
            "or the file of a picture",
            "background",
        )


def background(
    text: str, face: Reconstruction, photo: Photo, environment: np.ndarray
) -> Background:
    """What `text` names, for frames of the photo's size; environment: (H, W[, 3]), the new light.

    Raises PhotoError where a picture cannot be read.
    """
    height, width = photo.pixels.shape[:2]
    if text == PHOTO:
        return lambda degrees: None
    if text == LIGHT:
        rays = _rays(face, width, height)
        return lambda degrees: seen(turned(environment, degrees), rays)
    colour = colour_of(text)
    if colour is not None:
        picture = np.broadcast_to(colour, (height, width, 3))
    else:
        picture = filling(read_photo(text).pixels, width, height)
    return lambda degrees: picture


def filling(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width, 3): the middle of a picture, scaled until it leaves nothing free."""
    rows, columns = picture.shape[:2]
    scale = max(width / columns, height / rows)
    taken = (
        min(max(round(width / scale), 1), columns),
        min(max(round(height / scale), 1), rows),
    )
    left, top = (columns - taken[0]) // 2, (rows - taken[1]) // 2
    part = np.ascontiguousarray(picture[top : top + taken[1], left : left + taken[0]])
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return cv2.resize(part, (width, height), interpolation=how)


def seen(environment: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32: radiance that comes from where the rays (H, W, 3) of a camera go."""
    rows, columns = environment.shape[:2]
    x, y, z = np.moveaxis(rays, -1, 0)
    column = np.arctan2(x, -z) / (2 * np.pi) % 1 * columns - 0.5
    row = np.arccos(y / np.linalg.norm(rays, axis=-1)) / np.pi * rows - 0.5
    light = coloured(environment)
    light = np.concatenate([light[:, -1:], light, light[:, :1]], axis=1).astype(np.float32)
    place = (column.astype(np.float32) + 1, row.astype(np.float32))
    return cv2.remap(light, *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _rays(face: Reconstruction, width: int, height: int) -> np.ndarray:
    """(H, W, 3): through the photo's pixels, world frame."""
    camera, crop = face.face.camera, face.photo.crop
    xs, ys = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return camera.unproject(crop.points(np.stack([xs, ys], axis=-1)), 1.0)
