"""The outline: found where skin meets the background, only there, and it moves the mesh rightly."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unlit.fit.landmarks import HeadFit, LandmarkProblem
from unlit.fit.outline import Outline, _along
from unlit.fit.state import State
from unlit.head.landmark_error import NO_ERROR
from unlit.head.model import HeadModel
from unlit.perception.parser import CLASSES
from unlit.perception.regions import Regions
from unlit.scene.camera import Camera
from unlit.scene.mesh import Mesh
from unlit.settings.fit import LandmarkFit, OutlineFit

SIZE = 256
CAMERA = Camera(SIZE, SIZE, 80 * SIZE / 26, SIZE / 2, SIZE / 2)


def person(head: HeadModel, yaw: float = 12) -> State:
    """One who is not the mean."""
    identity = np.zeros(len(head.identity))
    identity[:6] = (1.5, -1, 0.8, 0.5, -0.7, 0.6)
    turn = Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    return State(turn, np.array([0, 1.0, -88]), identity, np.zeros(len(head.expression)))


def vertices_at(head: HeadModel, state: State) -> np.ndarray:
    return state.placed(head.vertices(state.identity, state.expression)).astype(np.float32)


def seen(
    head: HeadModel, state: State, covered: str | None = None, size: int = SIZE, above: int = 0
) -> Regions:
    """What a flawless parser says of the bald person; covered: what lies on the rows above one."""
    camera = Camera(size, size, CAMERA.focal * size / SIZE, size / 2, size / 2)
    pixel = Mesh(vertices_at(head, state), head.triangles).camera_hits(camera).pixel.numpy()
    skin = np.zeros(size * size, np.float32)
    skin[pixel] = 1
    skin = skin.reshape(size, size)
    shares = np.zeros((192, 192, len(CLASSES)), np.float32)
    if covered is not None:
        skin[:above] = 0
    whole = cv2.resize(skin, (192, 192), interpolation=cv2.INTER_AREA)
    shares[..., CLASSES.index("skin")] = whole
    shares[..., CLASSES.index("background")] = 1 - whole
    if covered is not None:
        shares[: above * 192 // size] = 0
        shares[: above * 192 // size, :, CLASSES.index(covered)] = 1
    weights = np.zeros((size, size, 6), np.float32)
    weights[..., 0], weights[..., 5] = skin, 1 - skin
    return Regions(weights, shares)


def outline(head: HeadModel, regions: Regions, settings: OutlineFit | None = None) -> Outline:
    return Outline(head, CAMERA, regions, settings or OutlineFit())


def found_rows(head: HeadModel, state: State, about: Outline) -> np.ndarray:
    """Rows of the picture at which points of the true head's outline have found a border."""
    vertices = vertices_at(head, state)
    border = about.border(vertices)
    corners = vertices[head.triangles[border.triangle]]
    return CAMERA.project(np.einsum("nc,ncx->nx", border.weights, corners))[:, 1]


def test_the_true_head_has_no_error(head: HeadModel) -> None:
    """Its outline is found all around but at the neck's end, to a third of a pixel."""
    state = person(head)
    border = outline(head, seen(head, state)).border(vertices_at(head, state))
    assert len(border.distance) > 60
    assert abs(np.median(border.distance)) < 0.3
    assert np.percentile(np.abs(border.distance), 90) < 0.8
    assert np.allclose(border.weights.sum(axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("shift", [(0.5, 0.0), (-0.6, 0.3)])
def test_a_shifted_head_is_missed_by_its_shift(head: HeadModel, shift: tuple) -> None:
    state = person(head)
    moved = replace(state, translation=state.translation - (*shift, 0))
    border = outline(head, seen(head, state)).border(vertices_at(head, moved))
    pixels = np.array(shift) * (1, -1) * CAMERA.focal / 88
    assert np.median(np.abs(border.distance - border.across @ pixels)) < 0.5


def test_gradient_is_how_the_points_move(head: HeadModel) -> None:
    """Turn, shift and identity: against the points of a mesh that has really moved."""
    state = person(head)
    settings = OutlineFit(huber=1000.0, deviation=1.0, independent=6.5)
    about = outline(head, seen(head, state), settings)
    start = replace(state, translation=np.add(state.translation, (0.4, -0.3, 0)))
    matrix, gradient, cost = about.equations(start)
    border = about.border(vertices_at(head, start))
    error = -border.distance / (SIZE / 512)
    assert cost == pytest.approx(0.5 * np.sum(error**2))
    corners = head.triangles[border.triangle]
    for index in (0, 1, 2, 3, 4, 5, 6, 9, 80, len(gradient) - 1):
        step = 1e-3 if index < 6 else 0.05
        places = []
        for sign in (1, -1):
            move = np.zeros(len(gradient))
            move[index] = sign * step
            moved = start.moved(move)
            shape = head.vertices(moved.identity, moved.expression).astype(np.float64)
            point = np.einsum("nc,ncx->nx", border.weights, moved.placed(shape)[corners])
            places.append(CAMERA.project(point))
        taken = 2 * step if index < len(gradient) - 1 else step  # an expression stays at least 0
        change = np.sum((places[0] - places[1]) * border.across, axis=1) / taken
        rows = change / (SIZE / 512)
        assert gradient[index] == pytest.approx(rows @ error, rel=0.01, abs=0.05), index
        assert matrix[index, index] == pytest.approx(rows @ rows, rel=0.01, abs=1e-3), index


@pytest.mark.parametrize("covered", ["hair", "cloth"])
def test_what_hides_the_skin_is_no_outline(head: HeadModel, covered: str) -> None:
    """Where hair or cloth ends, and where it meets skin, the head need not."""
    state = person(head)
    about = outline(head, seen(head, state, covered, above=128))
    rows = found_rows(head, state, about)
    assert len(rows) > 20 and rows.min() > 126


def test_a_thin_band_of_hair_is_no_background(head: HeadModel) -> None:
    """Short hair, three pixels of it between scalp and wall."""
    state = person(head)
    regions = seen(head, state)
    assert regions.shares is not None
    skin = regions.shares[..., CLASSES.index("skin")]
    band = (cv2.dilate(skin, np.ones((7, 7))) > 0.5) & (skin < 0.5)
    band[96:] = False
    regions.shares[band] = 0
    regions.shares[band, CLASSES.index("hair")] = 1
    assert found_rows(head, state, outline(head, regions)).min() > 120


def test_unsure_skin_is_no_outline(head: HeadModel) -> None:
    state = person(head)
    regions = seen(head, state)
    unsure = np.where(np.arange(SIZE)[:, None, None] < 128, 0.7, 1).astype(np.float32)
    weights = regions.weights * unsure
    weights[..., 5] += 1 - weights.sum(axis=2)
    rows = found_rows(head, state, outline(head, replace(regions, weights=weights)))
    assert len(rows) > 20 and rows.min() > 122


def test_the_photos_edge_is_no_outline(head: HeadModel) -> None:
    """A head cut by the photo's edge: skin ends there, and the parser has seen nothing beyond."""
    state = person(head)
    regions = seen(head, state)
    assert regions.shares is not None
    cut = 80
    regions.shares[:, : cut * 192 // SIZE] = 0
    weights = regions.weights.copy()
    weights[:, :cut] = (0, 0, 0, 0, 0, 1)
    about = outline(head, replace(regions, weights=weights))
    border = about.border(vertices_at(head, state))
    assert len(border.distance) > 30
    assert np.abs(border.distance).max() < 3


def test_a_head_that_is_lost_costs_most(head: HeadModel) -> None:
    """The farther beside the photo's, the dearer, though fewer points find a border."""
    state = person(head)
    about = outline(head, seen(head, state))
    costs = [
        about.equations(replace(state, translation=np.add(state.translation, (shift, 0, 0))))[2]
        for shift in (0, 0.5, 1, 2, 3, 5, 8)
    ]
    assert (np.diff(costs[:-1]) > 0).all()
    assert costs[-1] > costs[4]  # part of the head is beyond the picture, and none finds a border


def test_points_are_evenly_apart(head: HeadModel) -> None:
    """On a disc: its length over the spacing, straight or diagonal."""
    rows, columns = np.indices((SIZE, SIZE)) - 128
    disc = (np.hypot(rows, columns) < 90).astype(np.float32)
    found = np.stack(_along(disc, 4.0), axis=1)
    assert len(found) == pytest.approx(2 * np.pi * 90 / 4, rel=0.08)
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert steps.min() > 2 and steps.max() < 6


def test_huber_holds_what_is_far(head: HeadModel) -> None:
    """With errors beyond it the gradient no longer grows with them."""
    state = person(head)
    about = outline(head, seen(head, state), OutlineFit(huber=2.0, deviation=1.0))
    gradients = [
        about.equations(replace(state, translation=np.add(state.translation, (x, 0, 0))))[1][3]
        for x in (0.03, 0.8, 1.2)
    ]
    assert gradients[1] > 2 * gradients[0]
    assert gradients[2] == pytest.approx(gradients[1], rel=0.25)


def test_without_background_nothing_is_said(head: HeadModel) -> None:
    """A face that fills the picture."""
    state = person(head)
    near = replace(state, translation=np.array([0, 0, -20.0]))
    matrix, gradient, cost = outline(head, seen(head, near)).equations(near)
    assert cost == 0 and not matrix.any() and not gradient.any()


def test_the_fit_takes_the_width_of_the_head(head: HeadModel) -> None:
    """Landmarks of the mean head on a wider one: the outline is met, and the fit is nearer."""
    state = person(head)
    truth = vertices_at(head, state)
    mean = state.placed(head.vertices(0 * state.identity, state.expression))
    marks = np.column_stack([CAMERA.project(head.landmarks(mean)), np.zeros(478)])
    about = outline(head, seen(head, state))
    known = (head, marks, CAMERA, LandmarkFit(), NO_ERROR)
    without = LandmarkProblem(*known).solve()
    pulled = LandmarkProblem(*known, outline=about).solve()

    def missed(fit: HeadFit) -> float:
        return float(np.abs(about.border(fit.vertices).distance).mean())

    assert missed(pulled) < 0.5 * missed(without)
    sides = np.abs(head.neutral[:, 0]) > 6
    errors = [
        np.abs(CAMERA.project(f.vertices) - CAMERA.project(truth))[sides, 0].mean()
        for f in (without, pulled)
    ]
    assert errors[1] < 0.7 * errors[0]


def test_a_large_crop_is_compared_small(head: HeadModel) -> None:
    """Four times the pixels give the same equations, in the settings' pixels."""
    state = person(head)
    start = replace(state, translation=np.add(state.translation, (0.4, 0, 0)))
    small = outline(head, seen(head, state)).equations(start)
    camera = replace(CAMERA, width=512, height=512, focal=2 * CAMERA.focal, cx=256, cy=256)
    large = Outline(head, camera, seen(head, state, size=512), OutlineFit()).equations(start)
    assert large[2] == pytest.approx(small[2], rel=0.1)
    scale = np.abs(small[1]).max()
    assert np.abs(large[1] - small[1]).max() < 0.1 * scale
    assert np.abs(large[0] - small[0]).max() < 0.1 * np.abs(small[0]).max()
