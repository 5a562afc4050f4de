"""Who is the person in a photo."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from saved_head import Saved
from unlit.photo.crop import Crop
from unlit.photo.photo import Photo, read_photo
from unlit.relighting import person
from unlit.relighting.person import CLASSES, around, find_person, resampled

SIZE = 240


def test_squares_of_the_same_centre() -> None:
    crop = Crop(np.array([[0.7, 0, -20.3], [0, 0.7, -8.6]]), 64)
    wide = around(crop, 2.5, 100)
    np.testing.assert_allclose(wide.inverse_points([50, 50]), crop.inverse_points([32, 32]))
    np.testing.assert_allclose(100 / wide.scale, 2.5 * 64 / crop.scale)


def test_resampling_keeps_places() -> None:
    """A ramp over the photo is the same ramp on another square of it."""
    source = Crop(np.array([[2.0, 0, -30], [0, 2.0, -10]]), 80)
    target = Crop(np.array([[1.2, 0, -20], [0, 1.2, -8]]), 30)
    place = np.arange(80) + 0.5
    ramp = np.broadcast_to(source.inverse_points(np.stack([place, place], 1))[:, 0], (80, 80))
    found = resampled(ramp.astype(np.float32), source, target)
    inner = np.arange(30) + 0.5
    wanted = target.inverse_points(np.stack([inner, inner], 1))[:, 0]
    np.testing.assert_allclose(found[10, 2:-2], wanted[2:-2], atol=0.02)


@pytest.fixture
def figure(monkeypatch: pytest.MonkeyPatch) -> tuple[Photo, np.ndarray]:
    """A red disc on blue, and a parser that knows only its middle and what is far from it."""
    ys, xs = np.mgrid[:SIZE, :SIZE] + 0.5
    distance = np.hypot(xs - 120, ys - 110)
    true = distance < 70
    noise = np.random.default_rng(0).normal(0, 0.01, (SIZE, SIZE, 1))
    pixels = np.where(true[..., None], (0.5, 0.1, 0.1), (0.05, 0.1, 0.4)) + noise
    share = np.clip((100 - distance) / 60, 0, 1).astype(np.float32)  # vague about the border

    def parse(image: np.ndarray, landmarks: np.ndarray, inside: np.ndarray) -> np.ndarray:
        # The landmarks tell where the square is.
        scale = landmarks[1, 0] - landmarks[0, 0]
        view = Crop(np.array([[scale, 0, landmarks[0, 0]], [0, scale, landmarks[0, 1]]]), 384)
        seen = cv2.resize(view.image(share) * inside, (192, 192), interpolation=cv2.INTER_AREA)
        shares = np.zeros((192, 192, len(CLASSES)), np.float32)
        shares[..., 0], shares[..., CLASSES.index("hair")] = 1 - seen, seen
        return shares

    monkeypatch.setattr(person, "parse", parse)
    return Photo.of(np.maximum(pixels, 0).astype(np.float32)), true


def test_the_border_is_the_photo_s(figure: tuple[Photo, np.ndarray]) -> None:
    photo, true = figure
    crop = Crop(np.array([[1.0, 0, -40.0], [0, 1.0, -30.0]]), 160)
    landmarks = crop.points(np.array([[0.0, 0.0], [1.0, 0.0]]))
    found = find_person(photo, crop, landmarks)
    assert found.alpha.shape == (SIZE, SIZE)
    assert np.abs(found.alpha - true).mean() < 0.01
    hair = resampled(found.hair, found.square, Crop(np.eye(2, 3), SIZE))
    assert hair[110, 120] > 0.9
    assert found.head.max() == 0
    cut = replace(photo, alpha=np.tile(np.linspace(0, 1, SIZE, dtype=np.float32), (SIZE, 1)))
    assert (find_person(cut, crop, landmarks).alpha <= cut.alpha).all()


def test_any_photo_is_taken(saved: Saved) -> None:
    """Noise: whatever is found is a share, and the same twice."""
    photo, seen = read_photo(saved.photo), saved.face.photo
    first, second = (find_person(photo, seen.crop, seen.landmarks) for _ in range(2))
    np.testing.assert_array_equal(first.alpha, second.alpha)
    assert first.alpha.min() >= 0
    assert first.alpha.max() <= 1


def test_where_the_photo_goes_on_the_new_light_ends_softly() -> None:
    """Not at rims that are the photo's own."""
    crop = Crop(np.array([[1.0, 0, 0], [0, 1.0, -50]]), 100)  # the photo's rows 50 to 150
    share = person._ending(crop, 100, 400, 0.2)
    assert share.shape == (100, 100) and share.dtype == np.float32
    assert (share[[0, -1]] < 0.01).all() and (share[40:60] == 1).all()
    np.testing.assert_array_equal(share, share[:, :1].repeat(100, axis=1))
    assert np.abs(np.diff(share, axis=0)).max() < 0.1


def test_a_person_far_from_the_face_is_a_person_still(
    figure: tuple[Photo, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond what is looked at: not relit, but not background either."""
    photo, true = figure
    ys, xs = np.mgrid[:SIZE, :SIZE] + 0.5
    true = true | ((ys > 110) & (np.abs(xs - 120) < 40))  # a body down to the photo's edge
    pixels = np.where(true[..., None], (0.5, 0.1, 0.1), photo.pixels).astype(np.float32)
    monkeypatch.setattr(person, "_REACH", 1.2)
    crop = Crop(np.array([[1.0, 0, -60.0], [0, 1.0, -50.0]]), 120)
    found = find_person(Photo.of(pixels), crop, crop.points(np.array([[0.0, 0.0], [1.0, 0.0]])))
    assert np.abs(found.alpha - true).mean() < 0.02
    assert found.alpha[225:, 100:140].min() > 0.95
    assert found.relit[225:].max() == 0
    assert found.relit[100:120, 110:130].min() > 0.999
    assert 0.1 < found.guessed < 0.5


def test_the_piece_with_the_face_is_kept() -> None:
    """Not a larger one beside it; small holes are closed."""
    both = np.zeros((60, 80), bool)
    both[10:30, 10:30] = True
    both[20:22, 20:22] = False
    face = np.zeros_like(both)
    face[12:28, 8:32] = True
    both[5:55, 40:78] = True
    found = person._whole(both, face)
    assert found[10:30, 10:30].all() and found.sum() == 400
    assert person._whole(both, np.zeros_like(face)).sum() == 50 * 38
