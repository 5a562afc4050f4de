"""Landmarks: agreement with MediaPipe's own run, and behaviour under what photos do to faces."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from skimage import data

from unlit.errors import FaceError
from unlit.perception import landmarks as module
from unlit.perception.landmarks import DetectedFace, find_faces
from unlit.perception.networks import BLENDSHAPES, network
from unlit.perception.topology import BLENDSHAPE_LANDMARKS, BLENDSHAPE_NAMES
from unlit.perception.views import Pyramid, Square


@pytest.fixture(scope="module")
def astronaut() -> np.ndarray:
    return data.astronaut()


@pytest.fixture(scope="module")
def face(astronaut: np.ndarray) -> DetectedFace:
    (face,) = find_faces(astronaut)
    return face


@pytest.fixture(scope="module")
def reference() -> dict:
    return json.loads(Path(__file__).with_name("astronaut_mediapipe.json").read_text())


def mean_distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one[:, :2] - other[:, :2], axis=1).mean())


def warp(image: np.ndarray, angle: float, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """The image turned counter-clockwise by degrees and scaled, and its (2, 3) matrix."""
    height, width = image.shape[:2]
    matrix = cv2.getRotationMatrix2D((width / 2 - 0.5, height / 2 - 0.5), angle, scale)
    turned = cv2.warpAffine(
        image, matrix, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
    )
    matrix[:, 2] += 0.5 - matrix[:, :2] @ (0.5, 0.5)
    return turned, matrix


def test_landmark_network_agrees_with_mediapipe(astronaut: np.ndarray, reference: dict) -> None:
    """Same view, same answer: preprocessing and decoding are MediaPipe's to a tenth of a pixel.

    MediaPipe counts pixel centres at integers in the photo and in the network's input, so its
    region is shifted by half a pixel of each in the image frame.
    """
    x, y, side, angle = reference["roi"]
    shift = 0.5 - 0.5 * side / module.RESOLUTION
    roi = Square(x + shift, y + shift, side, angle)
    found, score = module._run_landmarks(Pyramid(astronaut), roi)
    expected = np.array(reference["landmarks"])
    assert score > 0.99
    assert mean_distance(found - shift, expected) < 0.1
    assert np.abs(found[:, 2] - expected[:, 2]).mean() < 0.1


def test_blendshapes_agree_with_mediapipe(reference: dict) -> None:
    """From MediaPipe's landmarks the scores are MediaPipe's: subset, order and names are right."""
    points = np.array(reference["landmarks"])[BLENDSHAPE_LANDMARKS, :2]
    (scores,) = network(BLENDSHAPES)(points)
    for name, score in zip(BLENDSHAPE_NAMES, scores.ravel(), strict=True):
        assert score == pytest.approx(reference["blendshapes"][name], abs=2e-3), name


def test_whole_run_is_near_mediapipe(face: DetectedFace, reference: dict) -> None:
    """The refined landmarks stay within a pixel of MediaPipe's single pass (106 px face)."""
    expected = np.add(reference["landmarks"], (0.5, 0.5, 0))
    assert face.landmarks.shape == (478, 3)
    assert face.landmarks.dtype == np.float32
    assert mean_distance(face.landmarks, expected) < 1.0
    assert set(face.blendshapes) == set(reference["blendshapes"])
    for name, score in reference["blendshapes"].items():
        assert face.blendshapes[name] == pytest.approx(score, abs=0.15), name
    left, top, right, bottom = face.box
    assert left < face.landmarks[4, 0] < right
    assert top < face.landmarks[4, 1] < bottom


def test_is_deterministic(astronaut: np.ndarray, face: DetectedFace) -> None:
    """Two runs are bit-identical, on which the identical maps of two runs rest."""
    (again,) = find_faces(astronaut)
    assert np.array_equal(again.landmarks, face.landmarks)
    assert again.blendshapes == face.blendshapes


@pytest.mark.parametrize("angle", [-60, 45, 60])
def test_rolled_head(astronaut: np.ndarray, face: DetectedFace, angle: float) -> None:
    """Landmarks turn with the photo."""
    turned, matrix = warp(astronaut, angle)
    (found,) = find_faces(turned)
    expected = face.landmarks[:, :2] @ matrix[:, :2].T + matrix[:, 2]
    assert mean_distance(found.landmarks, expected) < 2


@pytest.mark.parametrize("height", [50, 80])
def test_small_face(astronaut: np.ndarray, face: DetectedFace, height: int) -> None:
    """A face of 50 or 80 px in 1000, too small for the detector at once, is found by its tiles."""
    _, top, _, bottom = face.box
    scale = height / (bottom - top)
    small = cv2.resize(astronaut, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    photo = np.full((1000, 1000, 3), 110, np.uint8)
    photo[300 : 300 + small.shape[0], 500 : 500 + small.shape[1]] = small
    (found,) = find_faces(photo)
    expected = face.landmarks[:, :2] * (small.shape[1] / astronaut.shape[1]) + (500, 300)
    assert mean_distance(found.landmarks, expected) < 0.02 * height


def test_two_faces_largest_first(astronaut: np.ndarray) -> None:
    """Every face is reported, the largest first: the caller chooses by size."""
    small = cv2.resize(astronaut, (256, 256), interpolation=cv2.INTER_AREA)
    photo = np.full((512, 800, 3), 110, np.uint8)
    photo[100:356, :256] = small
    photo[:, 288:] = astronaut
    first, second = find_faces(photo)
    assert first.box[2] - first.box[0] > second.box[2] - second.box[0]
    assert first.box[0] > 288 > second.box[2]


@pytest.mark.parametrize("blur", [0, 9])
def test_noise_has_no_face(blur: float) -> None:
    """Nothing is found in noise, fine or coarse, whichever of the searches is made."""
    noise = np.random.default_rng(3).integers(0, 256, (400, 500, 3), np.uint8)
    if blur:
        smooth = cv2.GaussianBlur(noise, (0, 0), blur)
        noise = cv2.normalize(smooth, smooth.copy(), 0, 255, cv2.NORM_MINMAX)
    assert find_faces(noise) == []


def test_parts_of_a_face_are_no_faces(astronaut: np.ndarray, face: DetectedFace) -> None:
    """Enlarged, eyes or mouth alone can set the detector off; one face stays one face."""
    large = cv2.resize(astronaut, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    (found,) = find_faces(large[200:1000, 500:1300])
    expected = face.landmarks[:, :2] * 4 - (500, 200)
    assert mean_distance(found.landmarks, expected) < 6


@pytest.mark.parametrize("shape", [(10, 10), (10, 10, 4), (0, 10, 3)])
def test_wrong_array_is_named(shape: tuple[int, ...]) -> None:
    """A grey, four-channel or empty image is refused in one line that says what is wanted."""
    with pytest.raises(FaceError, match=r"\(H, W, 3\) uint8"):
        find_faces(np.zeros(shape, np.uint8))


def test_mirrored_photo(astronaut: np.ndarray, face: DetectedFace) -> None:
    """Mirroring the photo mirrors the face: each landmark where its partner was, depth kept."""
    (mirrored,) = find_faces(np.ascontiguousarray(astronaut[:, ::-1]))
    pairs = np.array([(33, 263), (133, 362), (61, 291), (4, 4), (152, 152), (10, 10)])
    expected = face.landmarks[pairs[:, 1]]
    expected[:, 0] = astronaut.shape[1] - expected[:, 0]
    width = face.box[2] - face.box[0]
    assert mean_distance(mirrored.landmarks[pairs[:, 0]], expected) < 0.02 * width
    assert np.abs(mirrored.landmarks[pairs[:, 0], 2] - expected[:, 2]).max() < 0.1 * width


def test_depth_is_smaller_nearer_the_camera(face: DetectedFace) -> None:
    """The nose's tip lies before eyes, mouth and chin, the ears' sides of the face behind them."""
    depth = face.landmarks[:, 2]
    assert depth[4] < depth[[33, 263, 61, 291, 152]].min()
    assert depth[[234, 454]].min() > depth[[33, 263, 61, 291, 152]].max()
