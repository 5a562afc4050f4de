"""Blending values per region by soft masks, against the matrix product it is."""

import drjit as dr
import numpy as np

from unlit.machine.runtime import mitsuba
from unlit.optimize.blend import Blend
from unlit.scene.arrays import device

mi = mitsuba()


def test_blend_and_its_adjoint() -> None:
    """Values are masks @ values, gradients masks^T @ gradients, for colours and scalars at once."""
    rng = np.random.default_rng(1)
    masks, colours, scalars = rng.random((50, 4)), rng.random((4, 3)), rng.random(4)
    asked = rng.normal(size=(50, 4))
    sources = [device(mi.Color3f, colours), device(mi.Float, scalars)]
    dr.enable_grad(sources)
    colour, scalar = Blend(masks)(*sources)
    np.testing.assert_allclose(colour.numpy().T, masks @ colours, atol=1e-5)
    np.testing.assert_allclose(scalar.numpy(), masks @ scalars, atol=1e-5)
    loss = dr.sum(dr.dot(colour, device(mi.Color3f, asked[:, :3])))
    dr.backward(loss + dr.sum(scalar * device(mi.Float, asked[:, 3])))
    np.testing.assert_allclose(dr.grad(sources[0]).numpy().T, masks.T @ asked[:, :3], atol=1e-4)
    np.testing.assert_allclose(dr.grad(sources[1]).numpy(), masks.T @ asked[:, 3], atol=1e-4)
