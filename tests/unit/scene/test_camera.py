"""The pinhole camera and its agreement with Mitsuba's sensor."""

import numpy as np
import pytest

from unlit.machine.runtime import mitsuba
from unlit.scene.camera import Camera
from unlit.scene.mesh import Mesh, camera_rays

mi = mitsuba()

OFF_CENTRE = Camera(width=80, height=64, focal=210.0, cx=31.7, cy=40.2)


def test_project_inverts_unproject() -> None:
    """Any pixel at any depth comes back to itself; depth is -z."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform(-20, 120, (50, 2))
    depth = rng.uniform(5, 200, 50)
    points = OFF_CENTRE.unproject(pixels, depth)
    assert -points[:, 2] == pytest.approx(depth)
    assert OFF_CENTRE.project(points) == pytest.approx(pixels)


def test_convention() -> None:
    """x is right, y is up, the camera looks along -z; the image's y points down."""
    centre = OFF_CENTRE.project(np.array([0.0, 0.0, -50.0]))
    assert centre == pytest.approx([31.7, 40.2])
    right, up = OFF_CENTRE.project(np.array([[1.0, 0, -50], [0, 1.0, -50]]))
    assert right == pytest.approx([31.7 + 210 / 50, 40.2])
    assert up == pytest.approx([31.7, 40.2 - 210 / 50])


def test_directions_are_the_rays_of_the_pixel_centres() -> None:
    """`directions` and the mesh's Dr.Jit rays are one and the same."""
    directions = OFF_CENTRE.directions()
    assert directions.shape == (64, 80, 3)
    rays = camera_rays(OFF_CENTRE, mi.UInt32(np.arange(64 * 80, dtype=np.uint32)))
    assert rays.d.numpy().T.reshape(64, 80, 3) == pytest.approx(directions, abs=1e-6)
    pixel = OFF_CENTRE.project(directions[10, 20].astype(np.float64))
    assert pixel == pytest.approx([20.5, 10.5], abs=1e-3)


def test_mitsuba_sees_the_same_pixels() -> None:
    """Small squares at known points cover, in Mitsuba's image, the pixels `project` says."""
    wanted = np.array([[12.5, 9.5], [70.5, 30.5], [33.0, 55.0]])
    depth = np.array([60.0, 80.0, 100.0])
    centres = OFF_CENTRE.unproject(wanted, depth)
    half = 1.5 * depth / OFF_CENTRE.focal  # three pixels wide
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    vertices = (centres[:, None] + half[:, None, None] * corners).reshape(-1, 3)
    square = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = np.concatenate([square + 4 * k for k in range(3)])
    mesh = Mesh(vertices.astype(np.float32), triangles.astype(np.int32))
    sensor = mi.load_dict(OFF_CENTRE.mitsuba_sensor(2048))
    integrator = mi.load_dict({"type": "aov", "aovs": "dd:depth"})
    image = mi.render(mesh.scene, sensor=sensor, integrator=integrator).numpy()[..., -1]
    assert image.shape == (64, 80)
    ys, xs = np.mgrid[0:64, 0:80] + 0.5
    for (x, y), d in zip(wanted, depth, strict=True):
        near = (np.abs(xs - x) < 4) & (np.abs(ys - y) < 4)
        cover = np.where(near, image, 0) / d
        assert cover.sum() == pytest.approx(9.0, rel=0.02)
        assert (cover * xs).sum() / cover.sum() == pytest.approx(x, abs=0.03)
        assert (cover * ys).sum() / cover.sum() == pytest.approx(y, abs=0.03)
