"""segmentation.png: what perception takes each pixel of the crop for, in named colours."""

from __future__ import annotations

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..color import encode_srgb, luminance
from ..face.reconstruction import Reconstruction
from ..perception.parser import CLASSES, LENS, OTHERS
from ..perception.regions import REGIONS
from .images import png

#: sRGB, 0 to 255.
COLOURS = {
    "background": (40, 40, 40),
    "skin": (240, 190, 150),
    "lips": (220, 70, 90),
    "eyes": (240, 240, 240),
    "eyebrows": (150, 100, 60),
    "mouth": (130, 20, 40),
    "hair": (120, 80, 200),
    "beard": (70, 130, 230),
    "frame": (250, 220, 40),
    "clear lens": (90, 230, 230),
    "tinted lens": (20, 120, 120),
    "cloth": (90, 180, 90),
    "hand": (250, 140, 40),
}
_PHOTO = 0.35  # of a pixel's brightness is the photo's
_LINE = 1 / 24  # height of a name, of the picture's


def segmentation_png(reconstruction: Reconstruction) -> bytes:
    """A PNG file, as wide as the crop and a column for the names.

    Where no parser was asked (masks of a known scene) the regions' weights stand for its shares.
    """
    photo = reconstruction.photo
    shares = photo.regions.shares
    if shares is None:
        names = (*REGIONS, "background")
        shares = np.zeros((*photo.regions.weights.shape[:2], len(CLASSES)), np.float32)
        shares[..., [CLASSES.index(name) for name in names]] = photo.regions.weights
    return png(_with_names(_coloured(photo.image, shares)))


def _coloured(image: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(S, S, 3) uint8; a clear lens is laid over what is behind it."""
    size = len(image)
    palette = np.array([COLOURS[name] for name in CLASSES], np.float32)
    over = 0.5 * shares[..., LENS, None]
    flat = (1 - over) * (shares[..., OTHERS] @ palette[OTHERS]) + over * palette[LENS]
    flat = cv2.resize(flat, (size, size), interpolation=cv2.INTER_LINEAR)
    grey = 255 * encode_srgb(np.clip(luminance(image), 0, 1))[..., None]
    return np.rint((1 - _PHOTO) * flat + _PHOTO * grey).clip(0, 255).astype(np.uint8)


def _with_names(picture: np.ndarray) -> np.ndarray:
    height = len(picture)
    line = max(round(height * _LINE), 8)
    column = Image.new("RGB", (7 * line, height), (255, 255, 255))
    draw, font = ImageDraw.Draw(column), ImageFont.load_default(0.7 * line)
    for row, name in enumerate(CLASSES):
        top = round(row * 1.4 * line + 0.4 * line)
        draw.rectangle((line // 2, top, line // 2 + line, top + line), COLOURS[name], (120,) * 3)
        draw.text((2 * line, top), name, (30, 30, 30), font)
    return np.hstack([picture, np.asarray(column)])
