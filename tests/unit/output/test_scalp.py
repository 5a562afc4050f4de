"""The scalp in the hair's colour: which vertices, what colour, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest

from changed import changed
from small_head import CENTRE, DISTANCE, small_head
from unlit.errors import SettingsError
from unlit.face.reconstruction import Reconstruction
from unlit.head.model import VERTEX_REGIONS, HeadModel
from unlit.output import atlas as atlas_module
from unlit.output.atlas import SEEN, bake
from unlit.output.scalp import Hair, hair_of
from unlit.perception.parser import CLASSES, SIZE

HAIR = np.array([0.08, 0.05, 0.02])


def haired(r: Reconstruction, rows: float) -> Reconstruction:
    """Hair in the upper part of the crop, under a light of 0.5."""
    size = len(r.face.mask)
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[: int(rows * SIZE), :, CLASSES.index("hair")] = 1
    return changed(
        r,
        {
            "photo.image": np.broadcast_to(0.5 * HAIR, (size, size, 3)).astype("f4"),
            "photo.regions": replace(r.photo.regions, shares=shares),
            "images.diffuse_shading": np.full((size, size, 3), 0.5, "f4"),
        },
    )


def test_scalp_and_shown_hair_in_the_photo_s_colour(head: HeadModel):
    r = small_head(64)
    mesh = replace(
        r.face.mesh,
        vertices=head.neutral - np.array((0, 0, DISTANCE), np.float32),
        triangles=head.triangles,
        uv=head.uv,
        triangle_uv=head.triangle_uv,
    )
    hair = hair_of(haired(changed(r, {"face.mesh": mesh}), 0.4))
    np.testing.assert_allclose(hair.albedo, HAIR, rtol=1e-3)
    region = np.array(VERTEX_REGIONS)[head.vertex_region]
    assert hair.cover[region == "scalp"].all()
    assert not hair.cover[np.isin(region, ["ears", "neck", "eyes", "lips"])].any()
    skin = (region == "skin") & (head.neutral[:, 2] > 2)
    height = head.neutral[:, 1]
    assert hair.cover[skin & (height > 5)].mean() > 0.8
    assert not hair.cover[skin & (height < 0)].any()


def test_it_says_why_there_is_none():
    """No hair in the photo; a mesh of no head model."""
    with pytest.raises(SettingsError, match="shows no hair"):
        hair_of(haired(small_head(64), 0))
    with pytest.raises(SettingsError, match="not of the head model"):
        hair_of(haired(small_head(64), 0.4))


def test_only_what_was_not_measured_is_coloured(monkeypatch):
    r = small_head(albedo=lambda point: np.full((len(point), 3), 0.5), bend=0)
    cover = (r.face.mesh.vertices - CENTRE)[:, 1] > 0
    monkeypatch.setattr(atlas_module, "hair_of", lambda _: Hair(cover, HAIR))
    skin, hair = bake(r, 256), bake(r, 256, "hair")
    seen = skin.confidence == SEEN
    np.testing.assert_array_equal(hair.diffuse_albedo[seen], skin.diffuse_albedo[seen])
    np.testing.assert_array_equal(hair.confidence == SEEN, seen)
    top = hair.diffuse_albedo[int(0.12 * 256) : int(0.2 * 256), : 256 // 8]
    np.testing.assert_allclose(top, np.broadcast_to(HAIR, top.shape), rtol=0.05)
    low = hair.diffuse_albedo[int(0.5 * 256) : int(0.6 * 256), : 256 // 8]
    np.testing.assert_allclose(low, 0.5, rtol=0.05)
