"""The network's file, what it is told, and what it says of one photo."""

from __future__ import annotations

from importlib import resources

import numpy as np
import pytest
from skimage import data

from drawn_face import HIGH, WIDE, drawn_landmarks
from drawn_face import SIZE as DRAWN
from unlit.color import decode_srgb
from unlit.perception.landmarks import find_faces
from unlit.perception.parser import CLASSES, LENS, OTHERS, SIZE, contours, parse
from unlit.photo.crop import face_crop


def seen(rgb: np.ndarray, resolution: int = 512) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `parse` is told of the largest face of a photo."""
    face, (height, width) = find_faces(rgb)[0], rgb.shape[:2]
    crop = face_crop(face.landmarks, resolution, (width, height))
    image = crop.image(decode_srgb(rgb / 255))
    return image, crop.points(face.landmarks[:, :2]), crop.inside(width, height)


@pytest.fixture(scope="module")
def astronaut() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return seen(data.astronaut())


@pytest.fixture(scope="module")
def shares(astronaut: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    return parse(*astronaut)


def mean(shares: np.ndarray, name: str, rows: slice, columns: slice) -> float:
    """Of a class, in a part of the crop."""
    return float(shares[rows, columns, CLASSES.index(name)].mean())


def test_the_file_is_small() -> None:
    """Under 10 MB, as licences.md and the package promise."""
    file = resources.files("unlit.perception") / "parser.onnx"
    assert 1e6 < len(file.read_bytes()) < 10e6


def test_contours_are_filled_where_the_landmarks_are() -> None:
    """The oval's area; both eyes in one channel; closed lips have no inside."""
    landmarks = drawn_landmarks() * (SIZE / DRAWN)
    filled = contours(landmarks, SIZE)
    assert filled.shape == (5, SIZE, SIZE) and filled.min() == 0 and filled.max() == 1
    area = np.pi * WIDE * HIGH * (SIZE / DRAWN) ** 2
    assert filled[0].sum() == pytest.approx(area, rel=0.02)
    assert filled[1, :, : SIZE // 2].sum() == pytest.approx(
        filled[1, :, SIZE // 2 :].sum(), rel=0.1
    )
    assert (filled[3] <= filled[0]).all() and filled[4].sum() < 0.1 * filled[3].sum()


def test_shares_are_a_partition(shares: np.ndarray) -> None:
    """All but the lens, which lies over another class, sum to 1."""
    assert shares.shape == (SIZE, SIZE, len(CLASSES)) and shares.dtype == np.float32
    assert shares.min() >= 0 and shares.max() <= 1
    np.testing.assert_allclose(shares[..., OTHERS].sum(axis=-1), 1, atol=1e-5)
    assert shares[..., LENS].mean() < 0.02


def test_a_photo_of_a_person(shares: np.ndarray) -> None:
    """Learnt on path-traced heads, it holds on a photo: a cheek, hair at the side, the suit."""
    assert mean(shares, "skin", slice(90, 110), slice(60, 75)) > 0.9
    assert mean(shares, "hair", slice(50, 80), slice(160, 180)) > 0.8
    assert mean(shares, "cloth", slice(182, 192), slice(60, 130)) > 0.8
    for name in ("frame", "tinted lens", "beard"):
        assert shares[..., CLASSES.index(name)].mean() < 0.02


def test_colour_is_not_needed(astronaut: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """The same photo in grey: the same face."""
    image, landmarks, inside = astronaut
    grey = np.repeat(image.mean(axis=-1, keepdims=True), 3, axis=-1)
    skin = [parse(x, landmarks, inside)[..., CLASSES.index("skin")] > 0.5 for x in (image, grey)]
    assert (skin[0] & skin[1]).sum() / (skin[0] | skin[1]).sum() > 0.85


def test_is_deterministic(
    astronaut: tuple[np.ndarray, np.ndarray, np.ndarray], shares: np.ndarray
) -> None:
    """Two runs are bit-identical, and the crop's resolution hardly matters."""
    np.testing.assert_array_equal(parse(*astronaut), shares)
    other = parse(*seen(data.astronaut(), 256))
    assert np.abs(other - shares).mean() < 0.02
