"""Regions: what masks promise whatever the photo, and the cases that ruin albedo if mistaken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from unlit.color import decode_srgb
from unlit.errors import FaceError
from unlit.perception import regions as regions_module
from unlit.perception.landmarks import find_faces
from unlit.perception.measures import coverage, smooth_contour
from unlit.perception.parser import CLASSES, SIZE
from unlit.perception.regions import Regions, segment
from unlit.perception.topology import FACE_OVAL, LEFT_EYE, LIPS_INNER, LIPS_OUTER, RIGHT_EYE
from unlit.photo.crop import face_crop


class Subject:
    """A crop in linear sRGB and its landmarks."""

    def __init__(self, rgb: np.ndarray, resolution: int = 512) -> None:
        face = find_faces(rgb)[0]
        height, width = rgb.shape[:2]
        crop = face_crop(face.landmarks, resolution, (width, height))
        self.image = crop.image(decode_srgb(rgb / 255))
        self.in_photo = crop.inside(width, height)
        self.landmarks = crop.points(face.landmarks[:, :2])
        self.blendshapes = face.blendshapes

    def regions(self, **changed: Any) -> Regions:
        """With some of what `segment` is told changed."""
        told = {
            "image": self.image,
            "landmarks": self.landmarks,
            "blendshapes": self.blendshapes,
            "inside": self.in_photo,
        }
        return segment(**(told | changed))

    def inside(self, indices: tuple[int, ...]) -> np.ndarray:
        contour = smooth_contour(self.landmarks[list(indices)])
        return coverage(contour, self.image.shape[0]) > 0.5


@pytest.fixture(scope="module")
def astronaut() -> Subject:
    return Subject(data.astronaut())


@pytest.fixture(scope="module")
def regions(astronaut: Subject) -> Regions:
    return astronaut.regions()


def test_masks_are_a_partition(regions: Regions) -> None:
    """Weights are in [0, 1] and sum to 1 at every pixel."""
    assert regions.weights.shape == (512, 512, 6)
    assert regions.weights.dtype == np.float32
    assert regions.weights.min() >= 0
    assert regions.weights.max() <= 1
    assert np.allclose(regions.weights.sum(axis=-1), 1, atol=1e-5)
    for index in range(6):
        assert (regions.weights[..., index] > 0.9).sum() > 100


def test_properties_name_the_channels(regions: Regions) -> None:
    """Names and channel order agree, and the face is all but the background."""
    names = ("skin", "lips", "eyes", "eyebrows", "mouth", "background")
    for index, name in enumerate(names):
        assert np.shares_memory(getattr(regions, name), regions.weights[..., index])
    assert np.allclose(regions.face, 1 - regions.background, atol=1e-5)


def test_features_lie_where_they_should(astronaut: Subject, regions: Regions) -> None:
    """Lips, eyes and mouth lie inside the oval; lips around the mouth, brows above the eyes."""
    oval = astronaut.inside(FACE_OVAL)
    for mask in (regions.lips, regions.eyes, regions.mouth, regions.eyebrows):
        assert mask[~oval].max() < 0.5
    assert regions.lips[~astronaut.inside(LIPS_OUTER)].max() < 0.6
    assert regions.mouth[~astronaut.inside(LIPS_INNER)].max() < 0.6
    rows = np.arange(512)[:, None]

    def height(mask: np.ndarray) -> float:
        return float((rows * mask).sum() / mask.sum())

    assert height(regions.eyebrows) < height(regions.eyes) < height(regions.lips)


def test_left_and_right_are_alike(astronaut: Subject, regions: Regions) -> None:
    """On a nearly frontal face both eyes are found, of areas within a factor of 1.5."""
    areas = [regions.eyes[astronaut.inside(eye)].sum() for eye in (RIGHT_EYE, LEFT_EYE)]
    assert 1 / 1.5 < areas[0] / areas[1] < 1.5


def test_hair_and_surroundings_are_no_skin(regions: Regions) -> None:
    """The astronaut's brown hair and smooth fringe, suit and backdrop; an ear is skin.

    The hair is told from skin by place: rows above 95 of the crop are all hair.
    """
    assert (regions.skin[:95] > 0.5).mean() < 0.01
    assert regions.skin[:95].mean() < 0.03
    assert regions.skin[:230, :85].max() < 0.2 and regions.skin[310:, :85].max() < 0.2
    assert regions.skin[250:270, 75:85].mean() > 0.3  # an ear
    assert regions.skin[495:].max() < 0.2  # the suit
    assert regions.skin[250:310, 150:200].min() > 0.95  # cheek
    assert regions.skin[440:460, 270:330].min() > 0.8  # neck


def test_smile_shows_teeth(astronaut: Subject, regions: Regions) -> None:
    """The mouth region is the open smile, not lips."""
    assert regions.mouth[astronaut.inside(LIPS_INNER)].mean() > 0.8


def test_closed_lips_have_no_mouth(astronaut: Subject) -> None:
    """With the inner contours together there is no mouth, and the lips fill its place."""
    landmarks = astronaut.landmarks.copy()
    upper, lower = list(LIPS_INNER[1:10]), list(LIPS_INNER[:10:-1])
    landmarks[upper] = landmarks[lower] = (landmarks[upper] + landmarks[lower]) / 2
    found = astronaut.regions(landmarks=landmarks)
    assert found.mouth.max() == 0
    assert found.lips[astronaut.inside(LIPS_INNER)].mean() > 0.9


def test_parted_landmarks_on_closed_lips(astronaut: Subject) -> None:
    """Where the landmarks part lips that show neither teeth nor dark, the mouth stays closed."""
    image = astronaut.image.copy()
    image[astronaut.inside(LIPS_OUTER)] = (0.35, 0.12, 0.1)
    found = astronaut.regions(image=image)
    assert found.mouth.max() == 0


def test_closed_eyes_are_skin(astronaut: Subject) -> None:
    """A shut lid is skin, whether the landmarks or the blink score say so."""
    landmarks = astronaut.landmarks.copy()
    upper, lower = list(RIGHT_EYE[1:8]), list(RIGHT_EYE[:8:-1])
    landmarks[upper] = landmarks[lower] = (landmarks[upper] + landmarks[lower]) / 2
    blink = {**astronaut.blendshapes, "eyeBlinkLeft": 0.95}
    found = astronaut.regions(landmarks=landmarks, blendshapes=blink)
    assert found.eyes.max() == 0
    assert found.skin[astronaut.inside(LEFT_EYE)].mean() > 0.9


@pytest.mark.parametrize("lit", ["left", "right"])
def test_hard_shadow_is_skin(astronaut: Subject, regions: Regions, lit: str) -> None:
    """Half the face at a sixteenth of the light with a sharp edge: the face stays the same."""
    columns = np.arange(512)
    nose = astronaut.landmarks[4, 0]
    bright = columns < nose if lit == "left" else columns > nose
    image = astronaut.image * np.where(bright, 1, 0.06)[None, :, None].astype(np.float32)
    found = astronaut.regions(image=image)
    before, after = regions.face > 0.5, found.face > 0.5
    assert (before & after).sum() / (before | after).sum() > 0.93


def test_dark_line_across_the_bridge_is_glasses(astronaut: Subject, regions: Regions) -> None:
    """Frames drawn around the eyes are cut out; the bare face has none."""
    image = astronaut.image.copy()
    eyes = [astronaut.landmarks[list(eye)].mean(axis=0) for eye in (RIGHT_EYE, LEFT_EYE)]
    frame = np.zeros((512, 512), np.uint8)
    for centre in eyes:
        cv2.circle(frame, tuple(int(v) for v in centre), 38, 1, 4)
    left, right = ((int(x), int(y)) for x, y in (eyes[0] + (38, 0), eyes[1] - (38, 0)))
    cv2.line(frame, left, right, 1, 4)
    image[frame > 0] = 0.01
    found = astronaut.regions(image=image)
    on_skin = (frame > 0) & (regions.skin > 0.9)
    assert found.face[on_skin].mean() < 0.2
    away = cv2.dilate(frame, np.ones((13, 13), np.uint8)) == 0
    assert (np.abs(found.face - regions.face)[away] > 0.5).mean() < 0.01


def test_is_deterministic(astronaut: Subject, regions: Regions) -> None:
    """Two runs are bit-identical."""
    assert np.array_equal(astronaut.regions().weights, regions.weights)


@pytest.mark.parametrize("resolution", [256, 1024])
def test_resolution_does_not_matter(regions: Regions, resolution: int) -> None:
    """The same face at half and twice the size gets the same regions."""
    other = Subject(data.astronaut(), resolution).regions().weights
    step = resolution / 512
    picked = (np.arange(8, 504, 4) * step).astype(int)
    same = np.abs(other[np.ix_(picked, picked)] - regions.weights[8:504:4, 8:504:4])
    assert same.mean() < 0.01


def test_a_photo_of_nothing_does_not_fail() -> None:
    """One grey: what is said of it is still a partition."""
    subject = Subject(data.astronaut(), 256)
    weights = subject.regions(image=np.full_like(subject.image, 0.2)).weights
    assert np.isfinite(weights).all() and weights.min() >= 0
    assert np.allclose(weights.sum(axis=-1), 1, atol=1e-5)


def test_what_is_outside_of_the_photo_is_background() -> None:
    """A photo that ends beside the nose, whose edge the crop repeats: nothing is found beyond."""
    rgb = data.astronaut()
    whole = Subject(rgb, 256)
    beyond = np.arange(256) >= whole.landmarks[4, 0]
    image = whole.image.copy()
    image[:, beyond] = image[:, ~beyond][:, -1:]
    inside = whole.in_photo & ~beyond
    found = whole.regions(image=image, inside=inside)
    assert found.background[:, beyond].min() == 1
    assert found.face[:, ~beyond].sum() > 0.3 * whole.regions().face.sum()


def test_the_dark_half_of_a_face_is_skin(astronaut: Subject, regions: Regions) -> None:
    """Without light, before a black wall: it says where the light is not, and stays in the mask."""
    nose = astronaut.landmarks[4, 0]
    black = np.arange(512)[None, :, None] > nose
    found = astronaut.regions(image=astronaut.image * ~black)
    inside = astronaut.inside(FACE_OVAL) & (regions.face > 0.9) & black[..., 0]
    assert found.face[inside].mean() > 0.9


def test_wrong_shapes_are_named(astronaut: Subject) -> None:
    """A crop that is not square, or too few landmarks, is refused in one line."""
    with pytest.raises(FaceError, match="square"):
        astronaut.regions(image=np.zeros((10, 12, 3)))
    with pytest.raises(FaceError, match=r"478"):
        astronaut.regions(landmarks=astronaut.landmarks[:468])


@pytest.mark.parametrize(
    ("name", "mouth_open"),
    [("A_006.jpg", False), ("A_047.jpg", False), ("A_009.jpg", True), ("A_039.jpg", True)],
)
def test_mouths_of_real_photos(shared: Path, name: str, mouth_open: bool) -> None:
    """Closed mouths stay closed, two-toned lips among them; teeth are found."""
    rgb = np.asarray(Image.open(shared / "data" / "photos" / name).convert("RGB"))
    found = Subject(rgb).regions()
    assert (found.mouth.max() > 0.9) == mouth_open
    assert 0.12 < found.skin.mean() < 0.45


@pytest.mark.parametrize(
    ("name", "rows", "looked_at", "is_skin"),
    [
        ("beard", slice(110, 192), slice(420, 440), False),
        ("beard", slice(118, 122), slice(318, 322), True),
        ("cloth", slice(40, 70), slice(144, 148), False),
        ("cloth", slice(48, 52), slice(131, 135), True),
    ],
)
def test_only_what_is_there_on_the_whole_covers(
    astronaut: Subject,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    rows: slice,
    looked_at: slice,
    is_skin: bool,
) -> None:
    """A narrow strip of beard below the nose or of cloth on the forehead is skin; much is not."""
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[:30, :, CLASSES.index("hair")] = 1
    shares[30:, :, CLASSES.index("skin")] = 1
    shares[rows, :, :] = np.eye(len(CLASSES), dtype=np.float32)[CLASSES.index(name)]
    monkeypatch.setattr(regions_module, "parse", lambda *_: shares)
    found = astronaut.regions().skin[looked_at, 230:280].mean()
    assert found > 0.5 if is_skin else found < 0.1


@pytest.mark.parametrize(("beard", "least", "most"), [(0.5, 0.0, 0.1), (0.2, 0.3, 0.9)])
def test_a_faint_beard_is_out(
    astronaut: Subject, monkeypatch: pytest.MonkeyPatch, beard: float, least: float, most: float
) -> None:
    """The network is unsure of real beards: half of it is a whole one, a fifth is stubble."""
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("skin")] = 1
    shares[110:, :, CLASSES.index("skin")] = 1 - beard
    shares[110:, :, CLASSES.index("beard")] = beard
    monkeypatch.setattr(regions_module, "parse", lambda *_: shares)
    found = astronaut.regions().skin
    assert least <= found[420:440, 230:280].mean() < most
    assert found[250:285, 150:200].min() > 0.95


def test_islands_in_the_hair_are_no_skin(
    astronaut: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What looks like skin amid hair is none, unless it is large, as a forehead between locks."""
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("hair")] = 1
    shares[70:, 50:150] = np.eye(len(CLASSES), dtype=np.float32)[CLASSES.index("skin")]
    for rows, columns in ((slice(20, 24), slice(20, 24)), (slice(20, 40), slice(100, 120))):
        shares[rows, columns] = shares[-1, 100]
    monkeypatch.setattr(regions_module, "parse", lambda *_: shares)
    image = np.full_like(astronaut.image, 0.3)
    found = astronaut.regions(image=image).face
    assert found[50:70, 50:70].max() < 0.1
    assert found[60:100, 275:310].min() > 0.5
