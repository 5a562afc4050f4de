"""Relighting a finished reconstruction."""

import numpy as np
import pytest

from bumpy_head import bumpy_head, camera, filtered, painted, view
from unlit.photo import Crop
from unlit.reconstruction import Reconstruction
from unlit.render.reference import path_trace
from unlit.scene.light import SphericalGaussians, disc

SIZE = 64


def test_relight_is_the_path_tracers() -> None:
    """A coloured side light on a Reconstruction gives what path tracing its parts gives."""
    vertices, triangles = bumpy_head()
    maps = painted(SIZE)
    scene = view(vertices, triangles, camera(SIZE), maps)
    normals = [scene.image(n) for n in (scene.points.diffuse_normal, scene.points.specular_normal)]
    mask = scene.inside(1)
    nothing = np.zeros((SIZE, SIZE), np.float32)
    face = Reconstruction(
        photo_name="",
        image=maps.diffuse_albedo,
        camera=scene.camera,
        crop=Crop(np.eye(2, 3), SIZE),
        vertices=vertices,
        triangles=triangles,
        uv=np.zeros((len(vertices), 2), np.float32),
        triangle_uv=triangles,
        diffuse_albedo=maps.diffuse_albedo,
        specular_albedo=maps.specular_albedo,
        roughness=maps.roughness,
        perturbation=maps.perturbation,
        specular_normal=normals[1],
        diffuse_normal=normals[0],
        diffuse_shading=nothing,
        specular_shading=nothing,
        render=maps.diffuse_albedo,
        mask=mask.astype(np.float32),
        regions=np.zeros((SIZE, SIZE, 6), np.float32),
        light=SphericalGaussians(np.eye(3, dtype="f4"), np.full(3, 9, "f4"), np.ones(3, "f4")),
        metrics={},
        settings={},
    )
    environment = disc((0.7, 0.3, 0.6), half_angle=6.0)[..., None] * np.array([1, 0.8, 0.5], "f4")
    ours = face.relight(environment)
    assert ours.shape == (SIZE, SIZE, 3)
    assert ours[~mask].max() == 0
    reference = path_trace(scene.mesh, scene.camera, maps, environment, 512, bounces=3)
    inside = scene.inside(5)
    a, b = filtered(ours)[inside], filtered(reference)[inside]
    assert np.abs(a - b).mean() < 0.007 * b.mean()
    assert a.mean(axis=0) == pytest.approx(b.mean(axis=0), rel=0.005)
    lobes = face.relight(face.light)
    assert lobes[mask].min() > 0
