"""Registration: lips and lids go to their landmarks, each by itself, and the rest stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import k1

from unlit.fit.registration import field_covariance, registered
from unlit.fit.state import State
from unlit.head.contact import LOWER_RIM, UPPER_RIM
from unlit.head.model import HeadModel
from unlit.perception.topology import LEFT_EYE, LIPS_INNER, LIPS_OUTER, RIGHT_EYE
from unlit.scene.camera import Camera
from unlit.scene.surface_points import SurfacePoints
from unlit.settings.fit import Registration

CAMERA = Camera(512, 512, 1500.0, 256, 256)
SETTINGS = Registration()
EVEN = np.ones(478)
LIPS = [*LIPS_OUTER, *LIPS_INNER]


@pytest.fixture(scope="module", params=[0, 25])
def state(request: pytest.FixtureRequest, head: HeadModel) -> State:
    turn = Rotation.from_euler("y", request.param, degrees=True).as_matrix()
    none = np.zeros(len(head.identity)), np.zeros(len(head.expression))
    return State(turn, np.array([0, 0, -80.0]), *none)


def seen(head: HeadModel, state: State, shape: np.ndarray) -> np.ndarray:
    return CAMERA.project(head.landmarks(state.placed(shape)))


def test_lips_follow_and_the_rest_stays(head: HeadModel, state: State) -> None:
    """Six pixels down and four aside: 70 % of it are taken up, in the image plane only."""
    shape = head.neutral.astype(np.float64)
    before = seen(head, state, shape)
    goal = before.copy()
    goal[LIPS] += (4, 6)
    moved = registered(head, CAMERA, state, shape, goal, EVEN, SETTINGS)
    after = seen(head, state, moved)
    assert np.median(np.linalg.norm(after - goal, axis=1)[LIPS]) < 0.3 * np.hypot(4, 6)
    away = np.linalg.norm((moved - shape), axis=1)
    mouth = np.nanmean(head.landmarks(shape)[LIPS], axis=0)
    assert away[np.linalg.norm(shape - mouth, axis=1) > 7].max() < 0.02
    depth = (state.placed(moved) - state.placed(shape))[:, 2]
    assert np.abs(depth).max() < 1e-4
    eyes = [*RIGHT_EYE, *LEFT_EYE]
    assert np.abs(after - before)[eyes].max() < 0.3


def test_one_lip_moves_without_the_other(head: HeadModel, state: State) -> None:
    """Closed in the model, open in the photo: they touch in space, and part all the same."""
    shape = head.neutral.astype(np.float64)
    goal = seen(head, state, shape)
    before = goal.copy()
    upper, lower = list(UPPER_RIM[2:-2]), list(LOWER_RIM[2:-2])
    goal[lower] += (0, 8)
    after = seen(head, state, registered(head, CAMERA, state, shape, goal, EVEN, SETTINGS))
    assert np.median((after - before)[lower, 1]) > 4
    assert np.abs(np.median((after - before)[upper, 1])) < 2


def test_a_landmark_says_more_across_its_contour(head: HeadModel, state: State) -> None:
    shape = head.neutral.astype(np.float64)
    before = seen(head, state, shape)
    lids = [*RIGHT_EYE[2:7], *RIGHT_EYE[10:15]]  # without the corners: along the x axis, nearly
    taken = []
    for shift in ((5, 0), (0, 5)):
        goal = before.copy()
        goal[list(RIGHT_EYE)] += shift
        after = seen(head, state, registered(head, CAMERA, state, shape, goal, EVEN, SETTINGS))
        taken.append(np.median((after - before)[lids] @ np.sign(shift)))
    assert taken[1] > taken[0] > 1


def test_larger_pixels_and_darker_light(head: HeadModel, state: State) -> None:
    """Twice the pixels give the same shape; landmarks in the dark move less."""
    shape = head.neutral.astype(np.float64)
    goal = seen(head, state, shape)
    goal[LIPS] += (0, 4)
    moved = registered(head, CAMERA, state, shape, goal, EVEN, SETTINGS)
    large = Camera(1024, 1024, 2 * CAMERA.focal, 512, 512)
    fine = registered(head, large, state, shape, 2 * goal, EVEN, SETTINGS)
    assert np.abs(fine - moved).max() < 1e-4
    dim = registered(head, CAMERA, state, shape, goal, 0.03 * EVEN, SETTINGS)
    assert np.abs(dim - shape).max() < 0.5 * np.abs(moved - shape).max()


def test_what_is_far_off_is_not_followed(head: HeadModel, state: State) -> None:
    """A lower lip that the landmarker sees 80 pixels, 4 cm, below: the mesh keeps its shape."""
    shape = head.neutral.astype(np.float64)
    goal = seen(head, state, shape)
    goal[list(LOWER_RIM[2:-2])] += (0, 80)
    moved = registered(head, CAMERA, state, shape, goal, EVEN, SETTINGS)
    assert np.linalg.norm(moved - shape, axis=1).max() < 3 * SETTINGS.deviation


def test_nothing_moves_what_is_where_it_should_be(head: HeadModel, state: State) -> None:
    shape = head.neutral.astype(np.float64)
    exact = registered(head, CAMERA, state, shape, seen(head, state, shape), EVEN, SETTINGS)
    assert np.abs(exact - shape).max() < 1e-5
    goal = seen(head, state, shape) + 5
    still = registered(head, CAMERA, state, shape, goal, EVEN, replace(SETTINGS, deviation=0.0))
    assert np.abs(still - shape).max() < 1e-5


def test_a_model_without_these_landmarks_is_left_alone(head: HeadModel, state: State) -> None:
    triangle = head.landmark_points.triangle.copy()
    triangle[[*LIPS, *RIGHT_EYE, *LEFT_EYE]] = -1
    bare = replace(head, landmark_points=SurfacePoints(triangle, head.landmark_points.barycentric))
    goal = seen(head, state, head.neutral) + 5
    assert registered(bare, CAMERA, state, head.neutral, goal, EVEN, SETTINGS) is head.neutral


def test_the_field_is_as_strong_and_as_wide_as_it_says(head: HeadModel) -> None:
    """On the skin, away from rims: standard deviation `deviation`; at `length` little in common."""
    settings = Registration(deviation=0.4, length=3.0)
    side = np.abs(head.neutral[:, 0]) > 3
    skin = np.flatnonzero((head.vertex_region == 0) & side & (head.neutral[:, 2] > 0))[::40]
    covariance = field_covariance(head, np.eye(len(head.neutral))[skin], settings)[skin]
    deviation = np.sqrt(np.diag(covariance))
    assert 0.3 < np.median(deviation) < 0.5
    correlation = covariance / np.outer(deviation, deviation)
    apart = np.linalg.norm(head.neutral[skin][:, None] - head.neutral[skin], axis=2)
    assert correlation[apart > 3.5].max() < 0.2
    near = (apart < 1.5) & (apart > 0.1)
    far = np.sqrt(8) / settings.length * apart[near]
    assert near.sum() > 50
    assert np.median(np.abs(correlation[near] - far * k1(far))) < 0.1  # Matérn's on a plane
