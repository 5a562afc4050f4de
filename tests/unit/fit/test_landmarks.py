"""Fitting: a known pose and shape come back, lips close, bounds hold, bad input is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unlit.errors import FaceError
from unlit.fit.landmarks import LandmarkProblem
from unlit.fit.state import State
from unlit.head.contact import LOWER_RIM, UPPER_RIM
from unlit.head.landmark_error import NO_ERROR, shipped_error
from unlit.head.sources.makehuman_learnt import shipped_prior
from unlit.perception.mouth import relative_gap
from unlit.perception.topology import LEFT_LID_GAP, LIP_GAP, LIPS_INNER, RIGHT_LID_GAP
from unlit.scene.camera import Camera
from unlit.settings.fit import LandmarkFit

SETTINGS = LandmarkFit()
CAMERA = Camera(512, 512, 1100.0, 250.0, 262.0)


def exact(head, landmarks, camera=CAMERA, settings=SETTINGS):
    """The fit to landmarks that have none of the landmarker's mean error."""
    return LandmarkProblem(head, landmarks, camera, settings, NO_ERROR).solve()


def seen(head, turn, place, identity=None, units=None):
    """Landmarks (478, 3) of a posed head, as the landmarker would give them."""
    expression = np.zeros(len(head.expression))
    for name, amount in (units or {}).items():
        expression[head.expression_names.index(name)] = amount
    identity = np.zeros(len(head.identity)) if identity is None else identity
    shape = head.vertices(identity, expression)
    world = head.landmarks(shape) @ turn.T + place
    depth = (-world[:, 2] - np.mean(-world[:, 2])) * CAMERA.focal / -np.mean(world[:, 2])
    return np.column_stack([CAMERA.project(world), depth]), shape @ turn.T + place


@pytest.mark.parametrize("angles", [(0, 0, 0), (5, 25, -10), (-10, -30, 5)])
def test_known_pose_comes_back(head, angles):
    """The mean head, projected and fitted, is found within half a degree and 3 mm."""
    turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    place = np.array([1.0, -2.0, -48.0])
    landmarks, vertices = seen(head, turn, place)
    fit = exact(head, landmarks)
    off = Rotation.from_matrix(fit.state.rotation @ turn.T).magnitude()
    assert np.degrees(off) < 0.5
    assert np.abs(fit.state.translation - place).max() < 0.3
    assert np.linalg.norm(fit.vertices - vertices, axis=-1).mean() < 0.3
    assert fit.landmark_residual < 0.01
    assert fit.vertices.dtype == np.float32 and np.isfinite(fit.vertices).all()


@pytest.mark.parametrize("roll", [0, 20])
def test_the_mean_error_is_taken_off(head, roll):
    """Landmarks that err as expected of this turn: the pose is found, and only that way."""
    yaw, pitch = 30, 5
    turn = Rotation.from_euler("ZYX", (roll, yaw, pitch), degrees=True).as_matrix()
    place = np.array([0, 0, -60.0])
    landmarks, _ = seen(head, turn, place)
    depth = -np.nanmean(head.landmarks(head.neutral) @ turn.T + place, axis=0)[2]
    error = shipped_error().expected(*np.radians((yaw, pitch))) * CAMERA.focal / depth
    cos, sin = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    landmarks[:, :2] += error @ np.array([[cos, -sin], [sin, cos]])
    centred = replace(CAMERA, cx=256, cy=256)  # the head is where the camera looks
    landmarks[:, :2] += (256 - CAMERA.cx, 256 - CAMERA.cy)

    def off(fit):
        return np.degrees(Rotation.from_matrix(fit.state.rotation @ turn.T).magnitude())

    assert off(LandmarkProblem(head, landmarks, centred, SETTINGS).solve()) < 1
    assert off(exact(head, landmarks, centred, SETTINGS)) > 2


def test_landmarks_in_the_dark_count_little(head):
    """Half a face in shadow, its landmarks drawn to the light: the pose comes from the other."""
    turn = np.eye(3)
    landmarks, _ = seen(head, turn, np.array([0, 0, -60.0]))
    edge = landmarks[4, 0] - 12
    dark = landmarks[:, 0] < edge
    landmarks[dark, 0] += 0.3 * (edge - landmarks[dark, 0])
    image = np.full((512, 512, 3), 0.5, dtype=np.float32)
    image[:, : int(edge) - 6] = 0.005

    def off(image):
        problem = LandmarkProblem(head, landmarks, CAMERA, SETTINGS, bias=NO_ERROR, image=image)
        return np.degrees(Rotation.from_matrix(problem.solve().state.rotation @ turn.T).magnitude())

    assert off(None) > 3
    assert off(image) < 0.6 * off(None)
    assert off(np.full_like(image, 0.2)) == pytest.approx(off(None), abs=0.01)


def test_turned_by_a_share(head):
    """Yaw halved, pitch and roll kept, the landmarks' middle where it was."""
    turn = Rotation.from_euler("ZYX", (5, 30, 4), degrees=True).as_matrix()
    landmarks, _ = seen(head, turn, np.array([0, 0, -60.0]))
    centred = replace(CAMERA, cx=256, cy=256)
    landmarks[:, :2] += (256 - CAMERA.cx, 256 - CAMERA.cy)
    problem = LandmarkProblem(head, landmarks, centred, SETTINGS, bias=NO_ERROR)
    middle = problem.neutral.mean(axis=0)
    units = np.zeros(len(head.identity)), np.zeros(len(head.expression))
    state = State(turn, np.array([0, 0, -60.0]) - turn @ middle, *units)
    half = problem.turned(state, 0.5)
    angles = Rotation.from_matrix(half.rotation).as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(angles, (5, 15, 4), atol=1.5)
    np.testing.assert_allclose(half.rotation @ middle + half.translation, (0, 0, -60), atol=1e-9)


def test_identity_and_expression_help(head):
    """Trusting exact landmarks, the fit beats the mean head's residual threefold for a stranger."""
    rng = np.random.default_rng(3)
    identity = np.clip(rng.normal(size=len(head.identity)), -1.5, 1.5)
    identity[len(shipped_prior().components) :] = 0  # displacements move landmarks by too little
    landmarks, _ = seen(head, np.eye(3), np.array([0, 0, -50.0]), identity, {"jawOpen": 0.5})
    fit = exact(head, landmarks, settings=LandmarkFit(deviation=8))
    mean = exact(head, landmarks, settings=LandmarkFit(deviation=1e6, gap_deviation=1e6))
    assert fit.landmark_residual < mean.landmark_residual / 3
    assert (fit.state.expression >= 0).all() and (fit.state.expression <= 1).all()
    assert fit.state.expression[head.expression_names.index("jawOpen")] > 0.15


def test_resolution_does_not_matter(head):
    """Distances scale with the crop: at twice the size the same head is found."""
    rng = np.random.default_rng(4)
    landmarks, _ = seen(
        head, np.eye(3), np.array([0, 0, -50.0]), rng.normal(size=len(head.identity))
    )
    large = Camera(1024, 1024, 2200.0, 500.0, 524.0)
    one, two = exact(head, landmarks), exact(head, landmarks * 2, large)
    np.testing.assert_allclose(one.vertices, two.vertices, atol=1e-3)


def test_closed_lips_are_closed(head):
    """Where the photo's lips touch the fitted rims touch, even if the landmarks part them a bit."""
    closed, _ = seen(head, np.eye(3), np.array([0, 0, -50.0]))
    for upper, lower in zip(UPPER_RIM[1:-1], LOWER_RIM[1:-1], strict=True):
        closed[[upper, lower], 1] += (-0.8, 0.8)
    corners = LIPS_INNER[0], LIPS_INNER[10]
    assert 0 < relative_gap(closed[:, :2], LIP_GAP, corners) < SETTINGS.closed
    fit = exact(head, closed)
    rims = head.landmarks(fit.vertices)[[UPPER_RIM, LOWER_RIM]]
    assert (rims[0, 1:-1, 1] - rims[1, 1:-1, 1]).max() < 0.01


def test_open_mouth_stays_open(head):
    """An open mouth is not sealed."""
    landmarks, _ = seen(head, np.eye(3), np.array([0, 0, -50.0]), units={"jawOpen": 0.5})
    fit = exact(head, landmarks)
    points = head.landmarks(fit.vertices)
    assert points[13, 1] - points[14, 1] > 0.5


def test_closed_lids_cover_the_eye(head):
    """Eyes shut in the photo are shut in the fit, and nothing is left inside the eyeball."""
    units = {"eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0}
    landmarks, _ = seen(head, np.eye(3), np.array([0, 0, -50.0]), units=units)
    fit = exact(head, landmarks)
    points, rest = head.landmarks(fit.vertices), head.landmarks(head.neutral)
    for upper, lower in RIGHT_LID_GAP + LEFT_LID_GAP:
        assert abs(points[upper, 1] - points[lower, 1]) < 0.2 * (rest[upper, 1] - rest[lower, 1])


def test_bad_landmarks_are_refused(head):
    """NaN or the wrong shape is a FaceError, not a NaN mesh."""
    with pytest.raises(FaceError, match="not 478 finite points"):
        LandmarkProblem(head, np.full((478, 3), np.nan), CAMERA, SETTINGS).solve()
    with pytest.raises(FaceError, match="not 478 finite points"):
        LandmarkProblem(head, np.zeros((68, 3)), CAMERA, SETTINGS).solve()
