"""Relighting a finished reconstruction."""

import numpy as np
import pytest

import tiny_run
from bumpy_head import bumpy_head, camera, filtered, painted, view
from small_head import small_head
from unlit.face.face import Face, Normals, PosedMesh
from unlit.relighting.lights import sun, turned
from unlit.render.reference import path_trace
from unlit.render.relighter import Relighter
from unlit.scene.cells import even_cells
from unlit.scene.light import SphericalGaussians, disc, uniform

SIZE = 64


def test_relight_is_the_path_tracers() -> None:
    """A coloured side light on a face gives what path tracing its parts gives."""
    vertices, triangles = bumpy_head()
    maps = painted(SIZE)
    scene = view(vertices, triangles, camera(SIZE), maps)
    normals = [scene.image(n) for n in (scene.points.diffuse_normal, scene.points.specular_normal)]
    mask = scene.inside(1)
    face = Face(
        scene.camera,
        PosedMesh(vertices, triangles, np.zeros((len(vertices), 2), np.float32), triangles),
        maps,
        Normals(normals[1], normals[0]),
        mask.astype(np.float32),
    )
    environment = disc((0.7, 0.3, 0.6), half_angle=6.0)[..., None] * np.array([1, 0.8, 0.5], "f4")
    relighter = Relighter(face)
    ours = relighter(environment)
    assert ours.shape == (SIZE, SIZE, 3)
    assert ours[~mask].max() == 0
    reference = path_trace(scene.mesh, scene.camera, maps, environment, 512, bounces=3)
    inside = scene.inside(5)
    a, b = filtered(ours)[inside], filtered(reference)[inside]
    assert np.abs(a - b).mean() < 0.007 * b.mean()
    assert a.mean(axis=0) == pytest.approx(b.mean(axis=0), rel=0.005)
    lobes = relighter(
        SphericalGaussians(np.eye(3, dtype="f4"), np.full(3, 9, "f4"), np.ones(3, "f4"))
    )
    assert lobes[mask].min() > 0


def test_a_light_that_turns() -> None:
    """Frames of one preparation are what the turned maps give when each is prepared alone."""
    relighter = Relighter(small_head(SIZE).face)
    colours = np.array([1, 0.8, 0.5], np.float32)
    for light in (sun(0, 25), (0.1 + disc((0, 0.4, 0.9), half_angle=12))[..., None] * colours):
        lit = relighter.under(light, [0, 77.7, -130])
        for number, degrees in enumerate((0, 77.7, -130)):
            alone = relighter(turned(light, degrees))
            frame = lit.image(number)
            assert np.abs(frame - alone).mean() < 0.01 * max(alone.mean(), 0.02)
    assert len(lit.cells) > len(even_cells()) > len(relighter.under(sun(0, 25), [0, 90]).cells)


def test_uniform_and_no_light() -> None:
    """A uniform light may turn as it likes; without light the picture is black."""
    relighter = Relighter(small_head(SIZE).face)
    lit = relighter.under(uniform(), [0, 33])
    assert lit.image(1) == pytest.approx(lit.image(0), rel=1e-5, abs=1e-6)
    assert relighter(0 * uniform()).max() == 0


def test_under_its_own_light() -> None:
    """A finished reconstruction under the light it found is its own `render`."""
    result = tiny_run.run()
    inside, render = result.face.mask > 0, result.images.render
    ours = Relighter(result.face)(result.light)
    assert render[inside].mean() > 0.1
    assert np.abs(ours - render)[inside].mean() < 0.01 * render[inside].mean()
