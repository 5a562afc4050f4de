"""The photometric fit: exact derivatives, a turn found from shading, caution in even light."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unlit.fit.landmarks import LandmarkProblem
from unlit.fit.shading import ShadingProblem
from unlit.fit.shape_jacobian import SeenPixels, ShapeJacobian
from unlit.fit.state import State
from unlit.head.landmark_error import NO_ERROR
from unlit.head.model import HeadModel
from unlit.machine.runtime import mitsuba
from unlit.perception.regions import Regions
from unlit.render.transport import Quadrature, ShadingPoints, shade, visibility
from unlit.scene.arrays import device
from unlit.scene.camera import Camera
from unlit.scene.cells import grid_cells, refine
from unlit.scene.light import disc, uniform
from unlit.scene.mesh import Mesh, surface, surface_weights
from unlit.settings.fit import LandmarkFit, ShadingFit

mi = mitsuba()
SIZE = 128
CAMERA = Camera(SIZE, SIZE, 90 * SIZE / 26, SIZE / 2, SIZE / 2)


def truth(head: HeadModel, yaw: float) -> State:
    """A person who is not the mean, turned by `yaw` degrees."""
    identity = np.zeros(len(head.identity))
    identity[:6] = (1, -1, 0.8, 0.5, -0.7, 0.6)
    turn = Rotation.from_euler("yx", [yaw, 3], degrees=True).as_matrix()
    return State(turn, np.array([0, 3.0, -88]), identity, np.zeros(len(head.expression)))


def placed(head: HeadModel, state: State) -> np.ndarray:
    shape = head.vertices(state.identity, state.expression)
    return (shape @ state.rotation.T + state.translation).astype(np.float32)


def test_jacobian_is_the_finite_difference(head: HeadModel) -> None:
    """Turn, shift, identity and expression: the change of normals at fixed pixels, as rendered."""
    state = truth(head, 15)
    mesh = Mesh(placed(head, state), head.triangles)

    def normals(state: State) -> np.ndarray:
        mesh.set_vertices(device(mi.Point3f, placed(head, state)))
        hits = mesh.camera_hits(CAMERA)
        n = surface(CAMERA, hits, mesh.vertices, mesh.normals, mesh.triangles)[1]
        image = np.zeros((SIZE * SIZE, 3), dtype=np.float32)
        image[hits.pixel.numpy()] = n.numpy().T
        return image

    before = normals(state)
    hits = mesh.camera_hits(CAMERA)
    weights = surface_weights(CAMERA, hits, mesh.vertices, mesh.triangles)[1]
    position = surface(CAMERA, hits, mesh.vertices, mesh.normals, mesh.triangles)[0]
    pixel, triangle = hits.pixel.numpy().astype(int), hits.triangle.numpy().astype(int)
    skin = (head.vertex_region[head.triangles[triangle]] == 0).all(axis=1)
    skin &= np.abs(before[pixel] @ (0, 0, 1)) > 0.4
    gradient = np.tile((0.6, 0.5, 0.3), (len(pixel), 1))
    seen = SeenPixels(
        state,
        head.vertices(state.identity, state.expression),
        pixel,
        triangle,
        weights.numpy().T,
        position.numpy().T,
        before.reshape(SIZE, SIZE, 3),
    )
    rows = ShapeJacobian(head, CAMERA).rows(seen, gradient)
    for unknown in (0, 1, 2, 3, 5, 6, 9, 20):
        move = np.zeros(rows.shape[1])
        move[unknown] = 0.01
        change = (normals(state.moved(move)) - normals(state.moved(-move)))[pixel] @ gradient[0]
        expected, got = change[skin] / 0.02, rows[skin, unknown]
        # A few pixels cross a fold or an edge of the mesh.
        error = np.abs(expected - got)
        usual = error < np.percentile(error, 90)
        assert np.corrcoef(expected[usual], got[usual])[0, 1] > 0.97, unknown
        assert np.polyfit(got[usual], expected[usual], 1)[0] == pytest.approx(1, abs=0.05), unknown


def photograph(head: HeadModel, state: State, light: np.ndarray) -> tuple[np.ndarray, Regions]:
    """The head in one even skin colour, shaded on fine cells, without inter-reflection."""
    mesh = Mesh(placed(head, state), head.triangles)
    hits = mesh.camera_hits(CAMERA)
    position, n, geometric = surface(CAMERA, hits, mesh.vertices, mesh.normals, mesh.triangles)
    points = ShadingPoints(position, n, n, geometric, dr.full(mi.Float, 0.3, dr.width(n)))
    cells = refine(grid_cells(), light)
    quadrature = Quadrature(cells)
    bits = visibility(mesh.scene, points, quadrature)
    e, s = shade(points, quadrature, bits, cells.average(light))
    image = np.zeros((SIZE * SIZE, 3), dtype=np.float32)
    value = (0.4 * e + 0.7 * s).numpy()
    image[hits.pixel.numpy()] = value[:, None] * np.array([1.0, 0.7, 0.5])
    region = head.vertex_region[head.triangles[hits.triangle.numpy()]]
    weights = np.zeros((SIZE * SIZE, 6), dtype=np.float32)
    weights[hits.pixel.numpy(), 0] = (region == 0).all(axis=1)
    weights[:, 5] = 1 - weights[:, 0]
    image *= 0.7 / np.percentile(image, 99)
    return image.reshape(SIZE, SIZE, 3), Regions(weights.reshape(SIZE, SIZE, 6))


def seen(head: HeadModel, state: State) -> np.ndarray:
    """The landmarks (478, 3), pixels, of the head at `state`."""
    return np.column_stack([CAMERA.project(head.landmarks(placed(head, state))), np.zeros(478)])


def turned_away(state: State, yaw: float) -> State:
    """The same head turned by a further `yaw` degrees."""
    turn = Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    return replace(state, rotation=turn @ state.rotation)


def test_shading_corrects_a_turn(head: HeadModel) -> None:
    """Landmarks that are five degrees off in yaw: half of the error is gone under a lamp."""
    state = truth(head, 15)
    image, regions = photograph(head, state, disc((0.5, 0.3, 0.8)))
    wrong = turned_away(state, -5)
    problem = LandmarkProblem(head, seen(head, wrong), CAMERA, LandmarkFit(), bias=NO_ERROR)
    fit = problem.fit(wrong, mouth_closed=False)
    better = ShadingProblem(problem, image, regions, ShadingFit()).solve(fit, False)

    def off(rotation: np.ndarray) -> float:
        return np.degrees(Rotation.from_matrix(rotation @ state.rotation.T).magnitude())

    assert off(fit.state.rotation) == pytest.approx(5, abs=0.1)
    assert off(better.state.rotation) < 3
    error = [np.linalg.norm(f.vertices - placed(head, state), axis=1).mean() for f in (fit, better)]
    assert error[1] < error[0]


def test_several_starts_find_the_turn_of_a_face_half_in_shadow(head: HeadModel) -> None:
    """Twelve degrees too much yaw, as landmarkers see there: one descent leaves most of it."""
    state = truth(head, -12)
    image, regions = photograph(head, state, disc((0.95, 0.1, 0.2)))
    wrong = turned_away(state, -12)
    problem = LandmarkProblem(
        head, seen(head, wrong), CAMERA, LandmarkFit(), bias=NO_ERROR, image=image
    )
    fit = problem.fit(wrong, mouth_closed=False)

    def off(settings: ShadingFit) -> float:
        found = ShadingProblem(problem, image, regions, settings).solve(fit, False)
        return np.degrees(Rotation.from_matrix(found.state.rotation @ state.rotation.T).magnitude())

    assert off(ShadingFit()) < 3 < 6 < off(ShadingFit(turns=()))


def test_steps_that_go_too_far_keep_the_best_on_the_way(
    head: HeadModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = truth(head, 15)
    image, regions = photograph(head, state, disc((0.5, 0.3, 0.8)))
    wrong = turned_away(state, -5)
    problem = LandmarkProblem(head, seen(head, wrong), CAMERA, LandmarkFit(), bias=NO_ERROR)
    fit = problem.fit(wrong, mouth_closed=False)
    shading = ShadingProblem(problem, image, regions, ShadingFit())
    step, made = shading.joint_step, []

    def too_far(*start: Any) -> Any:
        state, *rest = step(*start)
        made.append(start)
        return turned_away(state, -40) if len(made) == 4 else state, *rest

    monkeypatch.setattr(shading, "joint_step", too_far)
    better = shading.solve(fit, False)
    assert len(made) == ShadingFit().joint_steps
    off = [
        np.degrees(Rotation.from_matrix(x.state.rotation @ state.rotation.T).magnitude())
        for x in (fit, better)
    ]
    assert off[1] < 0.7 * off[0]


def test_even_light_keeps_the_landmarks_mesh(head: HeadModel) -> None:
    """Under a uniform sky the very same fit comes back."""
    state = truth(head, 0)
    image, regions = photograph(head, state, uniform())
    problem = LandmarkProblem(head, seen(head, state), CAMERA, LandmarkFit(), bias=NO_ERROR)
    fit = problem.fit(state, mouth_closed=False)
    assert ShadingProblem(problem, image, regions, ShadingFit()).solve(fit, False) is fit


def test_no_skin_keeps_the_landmarks_mesh(head: HeadModel) -> None:
    """A face of which too little plain skin is seen is left as it was."""
    state = truth(head, 0)
    problem = LandmarkProblem(head, seen(head, state), CAMERA, LandmarkFit(), bias=NO_ERROR)
    fit = problem.fit(state, mouth_closed=False)
    nothing = np.zeros((SIZE, SIZE, 6), dtype=np.float32)
    nothing[..., 5] = 1
    image = np.full((SIZE, SIZE, 3), 0.3, dtype=np.float32)
    shading = ShadingProblem(problem, image, Regions(nothing), ShadingFit())
    assert shading.solve(fit, False) is fit
