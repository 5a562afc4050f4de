"""Visibility bits against single shadow rays."""

import drjit as dr
import numpy as np
import pytest

from bumpy_head import View, bumpy_head, camera, painted, view
from unlit.machine.runtime import mitsuba
from unlit.render.transport import Quadrature, visibility
from unlit.render.visibility import HORIZON, OFFSET, visible, words
from unlit.scene.cells import grid_cells

mi = mitsuba()

CELLS = grid_cells(7, 10)  # 70 directions: two full words and six bits of a third


@pytest.fixture(scope="module")
def head() -> View:
    return view(*bumpy_head(3), camera(32), painted(32))


def test_words() -> None:
    """One bit per direction, rounded up to whole words."""
    assert [words(n) for n in (1, 32, 33, 648)] == [1, 1, 2, 21]


def test_bits_are_shadow_rays(head: View) -> None:
    """Every bit equals a shadow ray traced on its own; below the horizon all are dark."""
    quadrature = Quadrature(CELLS)
    count, points = len(CELLS), len(head.points)
    bits = visibility(head.mesh.scene, head.points, quadrature)
    assert dr.width(bits) == words(count) * points
    index = dr.arange(mi.UInt32, points * count)
    point, d = index // count, index % count
    seen = visible(bits, points, point, d).numpy().reshape(points, count)

    here = head.points.gather(point)
    towards = dr.gather(mi.Vector3f, quadrature.directions, d)
    start = here.position + OFFSET * here.geometric
    free = ~head.mesh.scene.ray_test(mi.Ray3f(start, towards))
    above = dr.dot(here.specular_normal, towards) > HORIZON
    assert (seen == (free & above).numpy().reshape(points, count)).all()
    cosine = dr.dot(here.specular_normal, towards).numpy().reshape(points, count)
    assert not seen[cosine < HORIZON].any()
    # A lobe whose normal is the specular one needs no ray below it; the others are the same.
    fewer = visibility(head.mesh.scene, head.points, quadrature, 0.0)
    kept = visible(fewer, points, point, d).numpy().reshape(points, count)
    assert (kept == (seen & (cosine > 0))).all()
    # The nose and the sockets do cast shadows: some directions above the horizon are blocked.
    assert 0.01 < (~seen[cosine > 0.2]).mean() < 0.2


def test_a_direction_may_be_free(head: View) -> None:
    """There nothing is blocked above the horizon; the others stay as they are."""
    quadrature = Quadrature(CELLS)
    points, count = len(head.points), len(CELLS)
    free = dr.arange(mi.UInt32, count) % 3 == 0
    index = dr.arange(mi.UInt32, points * count)
    point, d = index // count, index % count
    flags = dr.select(free, mi.UInt32(1), mi.UInt32(0))

    def seen(free: object) -> np.ndarray:
        bits = visibility(head.mesh.scene, head.points, quadrature, free=free)
        return visible(bits, points, point, d).numpy().reshape(points, count)

    before, after, which = seen(None), seen(flags), free.numpy()
    towards = dr.gather(mi.Vector3f, quadrature.directions, d)
    normal = dr.gather(mi.Vector3f, head.points.specular_normal, point)
    above = (dr.dot(normal, towards) > HORIZON).numpy().reshape(points, count)
    np.testing.assert_array_equal(after[:, ~which], before[:, ~which])
    np.testing.assert_array_equal(after[:, which], above[:, which])
    assert (after != before).any()
