"""The transport renderer: physics, parity with path tracing, and its derivatives."""

import dataclasses
from functools import cache

import drjit as dr
import numpy as np
import pytest

from bumpy_head import View, ball, bumpy_head, camera, filtered, painted, view
from unlit.machine.runtime import mitsuba
from unlit.render.reference import path_trace
from unlit.render.relighter import image_from_shading
from unlit.render.transport import (
    Linearization,
    Product,
    Quadrature,
    Transport,
    linearize,
    shade,
    visibility,
)
from unlit.scene.cells import grid_cells, refine
from unlit.scene.light import SphericalGaussians, disc, flash, uniform

mi = mitsuba()

SIZE = 96


def mixture() -> np.ndarray:
    """A light with a few broad and narrow lobes, in place of a photographed one."""
    axis = np.array([[0.6, 0.4, 0.7], [-0.8, 0.3, 0.2], [0, 1, 0], [0.1, -0.5, 0.9]])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    lobes = SphericalGaussians(
        axis.astype(np.float32), np.array([60, 20, 3, 2], "f4"), np.array([12, 4, 0.6, 0.3], "f4")
    )
    return lobes.rasterize()


LIGHTS = {
    "uniform": uniform(),
    "flash": flash(),
    "side": disc((0.87, 0.1, 0.5)),
    "mixture": mixture(),
}


@cache
def head() -> View:
    return view(*bumpy_head(), camera(SIZE), painted(SIZE))


@cache
def small() -> View:
    return view(*bumpy_head(3), camera(40), painted(40))


def test_white_sky_on_a_ball() -> None:
    """Nothing shadows a convex body: a uniform light of radiance 1 gives E = 1 everywhere."""
    unit, triangles = ball(4)
    vertices = (unit * 8 + (0, 0, -70)).astype(np.float32)
    flat = dataclasses.replace(painted(48), perturbation=np.zeros((48, 48, 3), np.float32))
    scene = view(vertices, triangles, camera(48), flat)
    quadrature = Quadrature(grid_cells())
    bits = visibility(scene.mesh.scene, scene.points, quadrature)
    e, s = shade(scene.points, quadrature, bits, grid_cells().average(uniform()))
    inside = scene.inside(1).ravel()[scene.pixel]
    assert np.abs(e.numpy()[inside] - 1).max() < 0.01
    assert e.numpy()[inside].mean() == pytest.approx(1, abs=2e-3)
    assert (s.numpy()[inside] > 0.02).all()


@pytest.mark.parametrize("name", LIGHTS)
def test_direct_light_is_the_path_tracers(name: str) -> None:
    """Same mesh, maps, light: at most 0.5 % mean error, no bias; the rest is the reference's noise.

    Both images are box-filtered over 5 x 5 pixels, inside the mask, off the silhouette.
    """
    scene, environment = head(), LIGHTS[name]
    reference = path_trace(scene.mesh, scene.camera, scene.maps, environment, 768, bounces=0)
    cells = refine(grid_cells(), environment)
    quadrature = Quadrature(cells)
    bits = visibility(scene.mesh.scene, scene.points, quadrature)
    e, s = shade(scene.points, quadrature, bits, cells.average(environment))
    ours = image_from_shading(scene.maps, scene.pixel, e.numpy()[:, None], s.numpy()[:, None])
    inside = scene.inside()
    assert inside.sum() > 1500
    a, b = filtered(ours)[inside], filtered(reference)[inside]
    assert np.abs(a - b).mean() < 0.005 * b.mean()
    assert a.mean() == pytest.approx(b.mean(), rel=0.002)


def test_colour_is_three_monochrome_lights() -> None:
    """A coloured light shades each channel as if it were alone."""
    scene, cells = small(), grid_cells(8, 16)
    quadrature = Quadrature(cells)
    bits = visibility(scene.mesh.scene, scene.points, quadrature)
    rgb = np.random.default_rng(0).random((len(cells), 3)).astype(np.float32)
    e, s = shade(scene.points, quadrature, bits, rgb)
    for channel in range(3):
        one = shade(scene.points, quadrature, bits, rgb[:, channel])
        assert e[channel].numpy() == pytest.approx(one[0].numpy(), rel=1e-5)
        assert s[channel].numpy() == pytest.approx(one[1].numpy(), rel=1e-5)


def test_product_and_its_transpose() -> None:
    """<U x, y> = <x, U^T y>, and both equal NumPy."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal((50, 7)).astype(np.float32)
    x, y = (rng.standard_normal(n).astype(np.float32) for n in (7, 50))
    product = Product(u)
    assert product.apply(mi.Float(x)).numpy() == pytest.approx(u @ x, abs=1e-4)
    assert product.apply_transposed(mi.Float(y)).numpy() == pytest.approx(u.T @ y, abs=1e-4)


def test_transport_matrices() -> None:
    """Equal to the sum over the cells; the gradient is the adjoint of the product."""
    scene, cells = small(), grid_cells()
    quadrature = Quadrature(cells)
    bits = visibility(scene.mesh.scene, scene.points, quadrature)
    transport = Transport(scene.points, quadrature, bits)
    radiance = cells.average(LIGHTS["mixture"])
    exact = shade(scene.points, quadrature, bits, radiance)
    x = mi.Float(radiance)
    dr.enable_grad(x)
    e, s = transport.shade(x)
    for ours, truth in zip((e, s), exact, strict=True):
        assert ours.numpy() == pytest.approx(truth.numpy(), rel=1e-4, abs=1e-6)
    rng = np.random.default_rng(2)
    ye, ys = (mi.Float(rng.standard_normal(len(scene.points)).astype(np.float32)) for _ in "es")
    dr.backward(dr.sum(ye * e) + dr.sum(ys * s))
    left = (ye.numpy().astype(float) @ e.numpy()) + (ys.numpy().astype(float) @ s.numpy())
    right = dr.grad(x).numpy().astype(float) @ radiance
    assert right == pytest.approx(left, rel=1e-4)


@cache
def _linearized() -> tuple[Linearization, Quadrature, object, np.ndarray]:
    scene, cells = small(), grid_cells()
    quadrature = Quadrature(cells)
    bits = visibility(scene.mesh.scene, scene.points, quadrature)
    radiance = cells.average(LIGHTS["mixture"])
    return linearize(scene.points, quadrature, bits, radiance), quadrature, bits, radiance


def test_linearization_is_exact_where_it_is_made() -> None:
    """At its own normals it gives the exact shading."""
    local, quadrature, bits, radiance = _linearized()
    points = small().points
    exact = shade(points, quadrature, bits, radiance)
    ours = local.shade(points.diffuse_normal, points.specular_normal)
    for a, b in zip(ours, exact, strict=True):
        assert a.numpy() == pytest.approx(b.numpy(), rel=1e-4, abs=1e-5)


def test_linearization_predicts_turned_normals() -> None:
    """Its slopes match central differences of the exact shading (visibility fixed) within 1 %.

    Off grazing angles, where the lobe's 1 / cos_o has no useful tangent.
    """
    local, quadrature, bits, radiance = _linearized()
    points = small().points
    rng = np.random.default_rng(3)
    free = mi.Vector3f(rng.standard_normal((3, len(points))).astype(np.float32))
    facing = dr.dot(points.specular_normal, points.to_viewer).numpy() > 0.2
    step = 0.003
    ends = []
    for sign in (1, -1):
        turned = dataclasses.replace(
            points,
            diffuse_normal=dr.normalize(points.diffuse_normal + sign * step * free),
            specular_normal=dr.normalize(points.specular_normal + sign * step * free),
        )
        exact = shade(turned, quadrature, bits, radiance)
        linear = local.shade(turned.diffuse_normal, turned.specular_normal)
        ends.append([x.numpy().astype(float)[facing] for x in (*exact, *linear)])
    e, s, linear_e, linear_s = (a - b for a, b in zip(*ends, strict=True))
    for truth, ours in ((e, linear_e), (s, linear_s)):
        assert np.linalg.norm(ours - truth) < 0.01 * np.linalg.norm(truth)
