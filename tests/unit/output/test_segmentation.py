"""segmentation.png: the crop in colours, and a column of names."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
from PIL import Image

from unlit.output.segmentation import COLOURS, segmentation_png
from unlit.perception.parser import CLASSES


def opened(face, regions):
    made = segmentation_png(replace(face, photo=replace(face.photo, regions=regions)))
    return np.asarray(Image.open(io.BytesIO(made)))


def test_every_class_has_a_colour_of_its_own():
    """No two of one colour, and none is missing."""
    assert set(COLOURS) == set(CLASSES) and len(set(COLOURS.values())) == len(CLASSES)


def test_a_class_is_seen_in_its_colour(face):
    """Hair on the left and cloth on the right, over the photo."""
    shares = np.zeros((192, 192, len(CLASSES)), np.float32)
    shares[:, :96, CLASSES.index("hair")] = 1
    shares[:, 96:, CLASSES.index("cloth")] = 1
    size = len(face.photo.image)
    picture = opened(face, replace(face.photo.regions, shares=shares))
    assert picture.shape[0] == size and picture.shape[1] > size
    grey = picture[size // 2, 1] - 0.65 * np.array(COLOURS["hair"])
    assert np.ptp(grey) <= 1 and grey.min() >= -1
    other = picture[size // 2, size - 2] - 0.65 * np.array(COLOURS["cloth"])
    assert np.ptp(other) <= 1


def test_masks_of_a_known_scene_are_shown_too(face):
    """Without shares the regions themselves are drawn."""
    weights = np.zeros_like(face.photo.regions.weights)
    weights[..., 1] = 1
    picture = opened(face, replace(face.photo.regions, weights=weights, shares=None))
    lips = picture[3, 3] - 0.65 * np.array(COLOURS["lips"])
    assert np.ptp(lips) <= 1
