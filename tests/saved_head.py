"""A small head as a saved result, and the photo that it was cut from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from changed import changed
from small_head import save_quickly, small_head
from unlit.face.reconstruction import Reconstruction
from unlit.output.save import save
from unlit.photo.crop import Crop
from unlit.photo.photo import read_photo

SIZE = 64


@dataclass(frozen=True)
class Saved:
    """face: what the folder `result` holds. photo: the PNG it was made from, 8 bits, 170 x 150."""

    face: Reconstruction
    result: Path
    photo: Path


def saved_head(place: Path) -> Saved:
    """Write photo and result into `place`. The rim of the mask is soft, as a segmentation's."""
    photo = place / "portrait.png"
    pixels = np.random.default_rng(5).integers(0, 256, (150, 170, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(photo)
    head = small_head(SIZE)
    distance = np.hypot(*(np.mgrid[:SIZE, :SIZE] - SIZE / 2))
    soft = np.clip(3 - 3 * distance / (0.4 * SIZE), 0, 1)
    crop = Crop(np.array([[0.7, 0, -20.3], [0, 0.7, -8.6]]), SIZE)
    face = changed(
        head,
        {
            "photo.crop": crop,
            "photo.image": np.maximum(crop.image(read_photo(photo).pixels), 0),
            "face.mask": (head.face.mask * soft).astype(np.float32),
        },
    )
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(face, place / "result")
    return Saved(face, place / "result", photo)
