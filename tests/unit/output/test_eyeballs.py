"""An eye that the photo hides is looked up on the other one."""

import numpy as np

from changed import changed
from small_head import CENTRE, EYE_COLOUR, small_head
from unlit.output.atlas import MIRRORED, SEEN, bake
from unlit.output.eyeballs import borrowed
from unlit.output.geometry import welded
from unlit.output.parts import EYES, parts


def test_it_lies_on_the_other_one_in_the_same_direction():
    r = small_head(32)
    mesh = welded(r)
    part = parts(r.face.mesh.vertices, r.face.mesh.triangles, r.face.mesh.triangle_uv)
    eyes = np.zeros(len(mesh.vertex), bool)
    eyes[np.unique(mesh.triangles[part == EYES])] = True
    left = eyes & (mesh.position[:, 0] > CENTRE[0])
    position, moved = borrowed(mesh, part, left)
    np.testing.assert_array_equal(moved, eyes & ~left)
    np.testing.assert_array_equal(position[~moved], mesh.position[~moved])
    shift = position[moved] - mesh.position[moved]
    np.testing.assert_allclose(shift, np.tile((5.6, 0, 0), (moved.sum(), 1)), atol=0.02)
    assert not borrowed(mesh, part, eyes)[1].any()
    assert not borrowed(mesh, part, ~eyes)[1].any()


def test_a_hidden_eye_has_the_colour_of_the_seen_one_and_says_so():
    r = small_head(shown=lambda point: point[:, 0] > CENTRE[0] - 0.5)
    atlas = bake(changed(r, {"photo.name": "one eye"}), 256)
    rows = slice(int(0.78 * 256), int(0.92 * 256))
    hidden, seen = (slice(int(u * 256), int((u + 0.2) * 256)) for u in (0.07, 0.42))
    assert (atlas.confidence[rows, seen] == SEEN).any()
    lent = atlas.confidence[rows, hidden] == MIRRORED
    assert lent.any()
    assert not (atlas.confidence[rows, hidden] == SEEN).any()
    np.testing.assert_allclose(
        atlas.diffuse_albedo[rows, hidden][lent], np.tile(EYE_COLOUR, (lent.sum(), 1)), atol=5e-3
    )
