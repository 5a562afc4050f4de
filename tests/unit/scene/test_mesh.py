"""The mesh, its normals, and what the camera sees of it."""

from typing import Any

import drjit as dr
import numpy as np
import pytest

from bumpy_head import ball, bumpy_head, camera
from unlit.machine.runtime import mitsuba
from unlit.scene.gather import Corners
from unlit.scene.mesh import (
    Mesh,
    barycentric,
    camera_rays,
    surface,
    surface_weights,
    vertex_normals,
)

mi = mitsuba()

SIZE = 64


@pytest.fixture(scope="module")
def head() -> Mesh:
    return Mesh(*bumpy_head(3))


def numpy_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Area-weighted vertex normals, the plain way."""
    corners = vertices[triangles].astype(np.float64)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(total, triangles[:, corner], face)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def test_vertex_normals(head: Mesh) -> None:
    """Equal to the plain sum over triangles, outward."""
    vertices, triangles = bumpy_head(3)
    normals = head.normals.numpy().T
    assert normals == pytest.approx(numpy_normals(vertices, triangles), abs=1e-5)
    unit, triangles = ball(3)
    normals = Mesh((unit * 5).astype(np.float32), triangles).normals.numpy().T
    assert (normals * unit).sum(axis=1).min() > 0.999


def test_vertex_without_triangles_is_no_nan() -> None:
    """A stray vertex has no normal; it must not spoil values or gradients."""
    vertices = mi.Point3f([0, 1, 0, 5], [0, 0, 1, 5], [-5, -5, -5, -5])
    dr.enable_grad(vertices)
    normals = vertex_normals(vertices, Corners(np.array([[0, 1, 2]]), dr.width(vertices)))
    assert np.isfinite(normals.numpy()).all()
    dr.backward(dr.sum(normals.x + normals.z))
    assert np.isfinite(dr.grad(vertices).numpy()).all()


def test_surface_is_mitsubas_intersection(head: Mesh) -> None:
    """Position, smooth normal and geometric normal of the G-buffer equal ray_intersect's."""
    view = camera(SIZE)
    hits = head.camera_hits(view)
    assert 0.3 < dr.width(hits.pixel) / SIZE**2 < 0.8
    position, normal, geometric = surface(view, hits, head.vertices, head.normals, head.triangles)
    si = head.scene.ray_intersect(camera_rays(view, hits.pixel))
    assert position.numpy() == pytest.approx(si.p.numpy(), abs=1e-3)
    assert geometric.numpy() == pytest.approx(si.n.numpy(), abs=1e-4)
    assert normal.numpy() == pytest.approx(si.sh_frame.n.numpy(), abs=1e-3)
    assert hits.triangle.numpy().tolist() == si.prim_index.numpy().tolist()
    pixel = hits.pixel.numpy()
    centres = np.stack([pixel % SIZE + 0.5, pixel // SIZE + 0.5], axis=1)
    assert view.project(position.numpy().T) == pytest.approx(centres, abs=1e-2)


def test_barycentric_extrapolates_and_differentiates() -> None:
    """Weights sum to 1, reproduce the plane outside the triangle too, and follow moved corners."""
    a, b, c = mi.Point3f(0, 0, -10), mi.Point3f(1, 0, -11), mi.Point3f(0, 1, -12)
    for ray in ((0.02, 0.03, -1.0), (0.2, 0.1, -1.0)):
        direction = dr.normalize(mi.Vector3f(*ray))
        w = barycentric(direction, a, b, c).numpy().ravel()
        assert w.sum() == pytest.approx(1, abs=1e-5)
        point = w @ np.array([[0, 0, -10], [1, 0, -11], [0, 1, -12]])
        assert np.cross(point, ray) == pytest.approx(np.zeros(3), abs=1e-4)

    def first_weight(x: float) -> float:
        return barycentric(direction, mi.Point3f(x, 0, -10), b, c).x.numpy().item()

    direction = dr.normalize(mi.Vector3f(0.02, 0.03, -1.0))
    x = mi.Float(0.0)
    dr.enable_grad(x)
    dr.backward(barycentric(direction, mi.Point3f(x, 0, -10), b, c).x)
    numeric = (first_weight(0.01) - first_weight(-0.01)) / 0.02
    assert dr.grad(x).numpy().item() == pytest.approx(numeric, rel=1e-3)


def test_smooth_normal_differentiates_with_the_vertices(head: Mesh) -> None:
    """Gradient of the seen normals with respect to all vertices against central differences."""
    view = camera(SIZE)
    hits = head.camera_hits(view)
    rng = np.random.default_rng(0)
    weight = mi.Vector3f(rng.standard_normal((3, dr.width(hits.pixel))).astype(np.float32))

    def loss(vertices: Any) -> Any:
        normals = vertex_normals(vertices, head.corners)
        _, normal, _ = surface(view, hits, vertices, normals, head.triangles)
        return dr.sum(dr.dot(weight, normal))

    start = mi.Point3f(head.vertices)
    direction = rng.standard_normal((3, dr.width(start))).astype(np.float32)
    dr.enable_grad(start)
    dr.backward(loss(start))
    slope = float((dr.grad(start).numpy().astype(np.float64) * direction).sum())
    ends = []
    for step in (0.003, -0.003):
        moved = mi.Point3f(head.vertices.numpy() + step * direction)
        ends.append(loss(moved).numpy().astype(np.float64).item())
    assert slope == pytest.approx((ends[0] - ends[1]) / 0.006, rel=0.01)


def test_moved_mesh_is_a_new_mesh(head: Mesh) -> None:
    """set_vertices leaves nothing behind: hits and normals are those of a mesh built afresh."""
    vertices, triangles = bumpy_head(3)
    moved = (vertices * (1.1, 0.9, 1.0) + (1.0, 0.5, -3.0)).astype(np.float32)
    old = Mesh(vertices, triangles)
    old.set_vertices(mi.Point3f(np.ascontiguousarray(moved.T)))
    new = Mesh(moved, triangles)
    a, b = old.camera_hits(camera(SIZE)), new.camera_hits(camera(SIZE))
    assert a.pixel.numpy().tolist() == b.pixel.numpy().tolist()
    assert a.triangle.numpy().tolist() == b.triangle.numpy().tolist()
    assert old.normals.numpy() == pytest.approx(new.normals.numpy(), abs=1e-6)
    corner, weight = surface_weights(camera(SIZE), a, old.vertices, old.triangles)
    assert weight.numpy().min() > -1e-3
    assert corner.numpy().max() < len(vertices)
