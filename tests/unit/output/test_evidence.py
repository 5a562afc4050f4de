"""What counts as evidence: not hair, not its rim, not the dark, not what is seen from the side."""

from dataclasses import replace

import numpy as np

from changed import changed
from small_head import CENTRE, small_head
from unlit.output.atlas import SEEN, bake
from unlit.output.evidence import hair_share, pixel_evidence, squareness
from unlit.perception.parser import CLASSES, SIZE
from unlit.scene.mesh import Mesh, surface

R = small_head()
PIXELS = len(R.face.mask)
CENTIMETRE = R.face.camera.focal / 72.0


def distance() -> np.ndarray:
    """(S, S) cm, of what the pixels show."""
    mesh = Mesh(R.face.mesh.vertices, R.face.mesh.triangles)
    hits = mesh.camera_hits(R.face.camera)
    at = surface(R.face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles)[0]
    out = np.full(PIXELS**2, 1e6)
    out[hits.pixel.numpy()] = -at.numpy()[2]
    return out.reshape(PIXELS, PIXELS)


def with_hair(share: np.ndarray):
    """The head with the parser's share of hair (192, 192)."""
    shares = np.zeros((SIZE, SIZE, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("hair")] = share
    regions = replace(R.photo.regions, shares=shares)
    return changed(R, {"photo.regions": regions})


def test_the_middle_of_the_face_counts_wholly_and_its_rim_not():
    found = pixel_evidence(R, distance(), CENTIMETRE)
    middle = slice(PIXELS // 2 + 8, PIXELS // 2 + 14)
    assert found[middle, middle].min() > 0.99
    assert found[R.face.mask == 0].max() == 0
    assert ((found > 0) & (found < 0.99)).any()


def test_hair_and_a_centimetre_around_it_do_not_count():
    """Where nobody asked the parser, no pixel shows hair."""
    assert hair_share(R).max() == 0
    share = np.zeros((SIZE, SIZE))
    share[: SIZE // 3] = 1
    r = with_hair(share)
    before, after = (pixel_evidence(x, distance(), CENTIMETRE) for x in (R, r))
    rows = np.arange(PIXELS)[:, None] + 0.5
    below = (rows - PIXELS / 3) / CENTIMETRE * np.ones(PIXELS)
    assert before[(below > -1) & (below < 0.2)].max() > 0.9
    assert after[below < 0.2].max() < 0.01
    np.testing.assert_allclose(after[below > 1.3], before[below > 1.3], atol=1e-6)


def test_specks_between_strands_are_no_evidence():
    """A patch of skin of half a centimetre counts nowhere."""
    x, y = np.meshgrid(*2 * [np.arange(PIXELS) - PIXELS // 2])
    speck = ((np.hypot(x - 12, y - 12) < 0.5 * CENTIMETRE) | (y < 0)).astype(np.float32)
    found = pixel_evidence(changed(R, {"face.mask": R.face.mask * speck}), distance(), CENTIMETRE)
    assert found[y > 2].max() == 0
    assert found.max() > 0.99


def test_where_no_light_falls_there_is_no_evidence():
    light = np.ones((PIXELS, PIXELS, 3), np.float32)
    light[:, : PIXELS // 2] = 0.01
    found = pixel_evidence(changed(R, {"images.diffuse_shading": light}), distance(), CENTIMETRE)
    assert found[:, : PIXELS // 2].max() == 0
    assert found[:, PIXELS // 2 :].max() > 0.99


def test_squareness_falls_smoothly():
    cosine = np.linspace(0, 1, 101)
    worth = squareness(cosine)
    assert worth[cosine < 0.24].max() == 0
    assert worth[cosine > 0.46].min() == 1
    assert 0 < np.diff(worth).max() < 0.1


def test_dark_strands_leave_nothing_on_the_atlas():
    """Hair that the mask takes for skin: its texels are not measured, and as light as the skin."""

    def strands(point: np.ndarray) -> np.ndarray:
        dark = (point - CENTRE)[:, 1:2] > 5
        return np.where(dark, 0.02, 0.5) * np.ones(3)

    share = np.zeros((SIZE, SIZE))
    share[: int(0.3 * SIZE)] = 1
    hairy = small_head(albedo=strands, bend=0)
    r = changed(with_hair(share), {"face": hairy.face})
    atlas = bake(r, 512)
    skin = slice(int(0.06 * 512), int(0.6 * 512))
    assert (atlas.confidence[skin] == SEEN).mean() > 0.05
    assert atlas.diffuse_albedo[skin].min() > 0.3
    assert bake(hairy, 512).diffuse_albedo[skin].min() < 0.1
