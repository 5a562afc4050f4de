"""Skin, eyeballs, teeth and the lining of the mouth are told apart by geometry."""

import numpy as np

from small_head import geometry, grid_ball
from unlit.output.parts import EYES, INSIDE, SKIN, TEETH, parts


def test_eyeballs_are_round_pieces_and_not_the_head_itself():
    """Two balls on a head; a head that is itself a ball is skin."""
    vertices, triangles, _, triangle_uv = geometry()
    found = parts(vertices, triangles, triangle_uv)
    skin = triangles.max(axis=1) < triangles[found == EYES].min()
    assert (found[skin] == SKIN).all()
    assert (found[~skin] == EYES).all()
    unit, triangles, _, triangle_uv = grid_ball(15, 24, (0, 0, 1, 1))
    assert (parts(unit.astype("f4"), triangles, triangle_uv) == SKIN).all()


def test_a_cavity_is_inside():
    """A bag turned inward within the head, which nothing of the outside can be seen from."""
    vertices, triangles, _, triangle_uv = geometry()
    bag, inner, _, inner_uv = grid_ball(15, 24, (0, 0, 1, 1))
    bag = bag * (4, 1.5, 2) + vertices.mean(axis=0)
    joined = np.concatenate([triangles, inner[:, ::-1] + len(vertices)])
    found = parts(
        np.concatenate([vertices, bag]).astype("f4"),
        joined,
        np.concatenate([triangle_uv, inner_uv + triangle_uv.max() + 1]),
    )
    assert (found[len(triangles) :] == INSIDE).all()
    assert set(found[: len(triangles)]) == {SKIN, EYES}


def test_a_bent_piece_is_a_row_of_teeth_and_a_straight_one_a_tongue():
    """Half a ring within the head, and a rod."""
    vertices, triangles, _, triangle_uv = geometry()
    tube, surface, _, surface_uv = grid_ball(15, 24, (0, 0, 1, 1))
    angle = 0.5 * np.pi * tube[:, 1]
    bow = np.stack([np.sin(angle), 0.3 * tube[:, 0], 1.5 * np.cos(angle)], axis=1)
    bow[:, [0, 2]] *= 1 + 0.1 * tube[:, 2:]
    for piece, kind in ((3 * bow, TEETH), (tube * (0.4, 3, 0.4), INSIDE)):
        found = parts(
            np.concatenate([vertices, piece + vertices.mean(axis=0)]).astype("f4"),
            np.concatenate([triangles, surface + len(vertices)]),
            np.concatenate([triangle_uv, surface_uv + triangle_uv.max() + 1]),
        )
        assert (found[len(triangles) :] == kind).all()
