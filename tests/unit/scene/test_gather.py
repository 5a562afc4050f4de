"""Gathering the corners of triangles: values, sums, and adjoints against plain loops."""

import drjit as dr
import numpy as np

from unlit.machine.runtime import mitsuba
from unlit.scene.arrays import device
from unlit.scene.gather import Corners

mi = mitsuba()

TRIANGLES = np.array([[0, 1, 2], [2, 1, 3], [3, 1, 0], [0, 2, 3]])
RNG = np.random.default_rng(0)


def test_values_and_totals() -> None:
    """Corner k of triangle f is the value at TRIANGLES[f, k]; totals add per element."""
    corners = Corners(TRIANGLES, 5)
    values, weights = RNG.normal(size=(5, 3)), RNG.normal(size=(4, 3))
    (picked,) = corners(device(mi.Vector3f, values))
    for k in range(3):
        np.testing.assert_allclose(picked[k].numpy().T, values[TRIANGLES[:, k]], atol=1e-6)
    plain = np.zeros((5, 3))
    np.add.at(plain, TRIANGLES.ravel(), np.repeat(weights, 3, axis=0))
    np.testing.assert_allclose(
        corners.total(device(mi.Vector3f, weights)).numpy().T, plain, atol=1e-6
    )


def test_adjoint_of_several_sources() -> None:
    """The gradient of a weighted sum of all corners is the plain scatter of the weights."""
    corners = Corners(TRIANGLES, 5)
    sources = [device(mi.Point3f, RNG.normal(size=(5, 3))) for _ in range(2)]
    dr.enable_grad(sources)
    weights = RNG.normal(size=(2, 3, 4, 3))
    loss = mi.Float(0)
    for s, picked in enumerate(corners(*sources)):
        for k, corner in enumerate(picked):
            loss += dr.sum(dr.dot(corner, device(mi.Vector3f, weights[s, k])))
    dr.backward(loss)
    for s in range(2):
        plain = np.zeros((5, 3))
        for k in range(3):
            np.add.at(plain, TRIANGLES[:, k], weights[s, k])
        np.testing.assert_allclose(dr.grad(sources[s]).numpy().T, plain, atol=1e-5)


def test_adjoint_of_total() -> None:
    """A triangle's gradient is the sum of what is asked at its three corners."""
    corners = Corners(TRIANGLES, 5)
    values, asked = device(mi.Vector3f, RNG.normal(size=(4, 3))), RNG.normal(size=(5, 3))
    dr.enable_grad(values)
    dr.backward(dr.sum(dr.dot(corners.total(values), device(mi.Vector3f, asked))))
    np.testing.assert_allclose(dr.grad(values).numpy().T, asked[TRIANGLES].sum(axis=1), atol=1e-5)


def test_no_triangles() -> None:
    """A mesh without landmarks asks for the corners of none."""
    corners = Corners(np.zeros((0, 3), dtype=int), 5)
    ((a, _, _),) = corners(device(mi.Point3f, RNG.normal(size=(5, 3))))
    assert dr.width(a) == 0
    assert not corners.total(a).numpy().any()
