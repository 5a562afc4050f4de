"""The atlas: what is measured is where it belongs, what is not is filled, and it says which."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from changed import changed
from small_head import CENTRE, EYE_COLOUR, SKIN_TRIANGLES, grid_ball, small_head
from unlit.color import encode_srgb
from unlit.face.conditions import Shadow
from unlit.face.face import PosedMesh
from unlit.face.reconstruction import Reconstruction
from unlit.machine.runtime import mitsuba
from unlit.output.atlas import BLENDED, DIFFUSED, MIRRORED, PLAIN, SEEN, Atlas, bake
from unlit.output.displacement import displacement
from unlit.output.eyes import Eye
from unlit.scene.brdf import specular
from unlit.scene.mesh import Mesh, surface_weights

mi = mitsuba()

SIZE = 512
LIGHT = np.array([0.4, 0.5, 0.77]) / np.linalg.norm([0.4, 0.5, 0.77])


class Seen:
    """The UV-mapped mesh as the photo's camera sees it, written independently of the baking."""

    def __init__(self, r: Reconstruction, atlas: Atlas) -> None:
        mesh = Mesh(r.face.mesh.vertices, r.face.mesh.triangles)
        hits = mesh.camera_hits(r.face.camera)
        weights = surface_weights(r.face.camera, hits, mesh.vertices, mesh.triangles)[1].numpy().T
        self.pixel, triangle = hits.pixel.numpy(), hits.triangle.numpy()
        self.skin = triangle < SKIN_TRIANGLES

        def at(values: np.ndarray) -> np.ndarray:
            corners = values[atlas.mesh.triangles[triangle]]
            return (weights[..., None] * corners).sum(axis=1)

        size = len(atlas.confidence)
        u, v = at(atlas.mesh.uv).T
        self.place = np.stack([(1 - v) * size - 0.5, u * size - 0.5])
        self.position, self.normal = at(atlas.mesh.position), at(atlas.mesh.normal)
        tangent = at(atlas.mesh.tangent)
        self.tangent = tangent[:, :3]
        self.across = tangent[:, 3:] * np.cross(self.normal, self.tangent)

    def look(self, image: np.ndarray) -> np.ndarray:
        """Bilinear look-up (P, C)."""
        channels = image.reshape(*image.shape[:2], -1)
        return np.stack(
            [
                map_coordinates(channels[..., k], self.place, order=1, mode="nearest")
                for k in range(channels.shape[-1])
            ],
            axis=1,
        )

    def world(self, image: np.ndarray) -> np.ndarray:
        """World normals (P, 3) of a tangent-space map, as MikkTSpace decodes it."""
        x, y, z = np.moveaxis(self.look(image)[..., None], 1, 0)
        n = x * self.tangent + y * self.across + z * self.normal
        return n / np.linalg.norm(n, axis=1, keepdims=True)


def shaded(maps, n_d, n_s, position) -> np.ndarray:
    """(P, 3) under one directional light: enough to feel every map."""
    albedo, gloss, rough = maps
    viewer = -position / np.linalg.norm(position, axis=1, keepdims=True)

    def vector(rows: np.ndarray):
        return mi.Vector3f(np.ascontiguousarray(rows.T, dtype=np.float32))

    towards = vector(np.repeat(LIGHT[None], len(position), axis=0))
    lobe = specular(vector(n_s), towards, vector(viewer), mi.Float(rough.ravel().astype("f4")))
    return albedo * np.maximum(n_d @ LIGHT, 0)[:, None] + gloss * lobe.numpy()[:, None]


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    a, b = (encode_srgb(np.clip(x, 0, 1)) for x in (a, b))
    return float(-10 * np.log10(((a - b) ** 2).mean()))


@pytest.fixture(scope="module")
def r() -> Reconstruction:
    return small_head()


@pytest.fixture(scope="module")
def atlas(r) -> Atlas:
    return bake(r, SIZE)


def test_round_trip(r, atlas):
    """From the photo's camera the UV-mapped mesh renders as the image-space maps, to 40 dB."""
    seen = Seen(r, atlas)
    inside = seen.look((atlas.confidence == SEEN).astype("f4"))[:, 0] > 0.999
    assert inside.mean() > 0.6

    def pixels(image: np.ndarray) -> np.ndarray:
        return image.reshape(len(r.face.mask) ** 2, -1)[seen.pixel]

    n_d, n_s = pixels(r.face.normals.diffuse), pixels(r.face.normals.specular)
    given = [
        pixels(x)
        for x in (r.face.maps.diffuse_albedo, r.face.maps.specular_albedo, r.face.maps.roughness)
    ]
    baked = [seen.look(x) for x in (atlas.diffuse_albedo, atlas.specular_albedo, atlas.roughness)]
    m_d, m_s = seen.world(atlas.diffuse_normal), seen.world(atlas.specular_normal)
    before = shaded(given, n_d, n_s, seen.position)[inside]
    after = shaded(baked, m_d, m_s, seen.position)[inside]
    assert psnr(before, after) > 40
    angle = np.degrees(np.arccos(np.clip((n_s * m_s).sum(axis=1), -1, 1)))[inside]
    assert np.percentile(angle, 95) < 1
    # It could fail: with the green channel upside down the normals are off by several degrees.
    flipped = seen.world(atlas.specular_normal * (1, -1, 1))
    assert np.degrees(np.arccos((n_s * flipped).sum(axis=1)[inside].clip(-1, 1))).mean() > 3


def test_displacement_is_that_of_the_pixels(r, atlas):
    """In millimetres, as the crop's; mirrored with its sign; nothing where nothing was seen."""
    seen = Seen(r, atlas)
    inside = seen.skin & (seen.look((atlas.confidence == SEEN).astype("f4"))[:, 0] > 0.999)
    given = displacement(r).ravel()[seen.pixel]
    found = seen.look(atlas.displacement)[:, 0]
    assert given[inside].std() > 0.05
    assert np.abs(found - given)[inside].mean() < 0.1 * given[inside].std()
    half = bake(small_head(shown=lambda point: point[:, 0] > CENTRE[0] - 0.5), SIZE)
    rows = slice(int(0.1 * SIZE), int(0.6 * SIZE))
    level, height = half.confidence[rows], half.displacement[rows]
    assert (level == MIRRORED).sum() > 1000
    mirrored = (level == MIRRORED) & (level[:, ::-1] == SEEN)
    twin = height[:, ::-1]
    assert np.corrcoef(height[mirrored], twin[mirrored])[0, 1] > 0.8
    back = atlas.displacement[rows, : SIZE // 16][atlas.confidence[rows, : SIZE // 16] == DIFFUSED]
    assert len(back) > 1000
    assert np.abs(back).max() < 0.02


def texel_points(r: Reconstruction, atlas: Atlas, triangle: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres (K, 3) of the texels of one triangle's inside, and their (row, column)."""
    uv = r.face.mesh.uv[r.face.mesh.triangle_uv[triangle]].astype(float)
    size = len(atlas.confidence)
    low, high = uv.min(axis=0) * size, uv.max(axis=0) * size
    x, y = np.meshgrid(
        np.arange(low[0], high[0]).astype(int), np.arange(low[1], high[1]).astype(int)
    )
    at = np.stack([x.ravel() + 0.5, y.ravel() + 0.5], axis=1) / size
    weights = np.linalg.solve(
        np.vstack([uv.T, np.ones(3)]), np.column_stack([at, np.ones(len(at))]).T
    ).T
    kept = (weights > 0.02).all(axis=1)
    points = weights[kept] @ r.face.mesh.vertices[r.face.mesh.triangles[triangle]]
    return points, np.stack([size - 1 - y.ravel()[kept], x.ravel()[kept]], axis=1)


def test_confidence_is_what_the_camera_sees(r, atlas):
    """Against shadow rays and angles computed texel by texel."""
    scene = Mesh(r.face.mesh.vertices, r.face.mesh.triangles).scene
    points, cells, normals = [], [], []
    for triangle in range(0, SKIN_TRIANGLES, 7):
        some, cell = texel_points(r, atlas, triangle)
        a, b, c = r.face.mesh.vertices[r.face.mesh.triangles[triangle]].astype(float)
        normal = np.cross(b - a, c - a)
        points.append(some)
        cells.append(cell)
        normals.append(np.repeat(normal[None] / np.linalg.norm(normal), len(some), axis=0))
    point, cell, normal = map(np.concatenate, (points, cells, normals))
    distance = np.linalg.norm(point, axis=1)
    cosine = -(normal * point).sum(axis=1) / distance
    start = point + 0.02 * normal
    to_camera = mi.Vector3f(*(-start / np.linalg.norm(start, axis=1, keepdims=True)).T.astype("f4"))
    ray = mi.Ray3f(mi.Point3f(*start.T.astype("f4")), to_camera)
    visible = ~scene.ray_test(ray).numpy() & (cosine > 0)
    level = atlas.confidence[tuple(cell.T)]
    assert visible[level >= BLENDED].mean() > 0.98
    square = visible & (cosine > 0.5)  # the silhouette, where the mask ends, is far away
    assert (level == SEEN)[square].mean() > 0.98
    assert not (level == SEEN)[cosine < 0.4].any()
    assert not (level >= BLENDED)[cosine < 0.25].any()


def test_unseen_half_is_mirrored(atlas):
    """Half of a symmetric face is measured: the other half is its mirror image, and marked so."""
    whole = atlas
    atlas = bake(small_head(shown=lambda point: point[:, 0] > CENTRE[0] - 0.5), SIZE)
    hidden = (whole.confidence == SEEN) & (atlas.confidence < BLENDED)
    rows, columns = np.nonzero(hidden)
    skin = rows < 0.64 * SIZE
    hidden = rows[skin], columns[skin]
    assert (atlas.confidence[hidden] == MIRRORED).mean() > 0.9
    error = np.abs(atlas.diffuse_albedo - whole.diffuse_albedo)[hidden]
    assert error.mean() < 0.006
    # The bend of the normals is symmetric too, so that x of tangent space changes its sign.
    assert np.abs(atlas.specular_normal - whole.specular_normal)[hidden].mean() < 0.02


def test_what_lies_in_a_cast_shadow_is_not_measured(r, atlas):
    """Where it is filled in, like what the camera does not see."""
    trust = (np.arange(r.face.mask.shape[1]) < 0.5 * r.face.mask.shape[1]) * np.ones_like(
        r.face.mask
    )
    shadow = Shadow(trust, np.ones((*trust.shape, 3), np.float32), trust)
    shadowed = bake(changed(r, {"conditions.shadow": shadow}), SIZE)
    left = bake(changed(r, {"face.mask": r.face.mask * trust}), SIZE)
    np.testing.assert_array_equal(shadowed.confidence, left.confidence)
    assert (shadowed.confidence >= BLENDED).sum() < 0.7 * (atlas.confidence >= BLENDED).sum()


def test_a_layout_without_mirror_axis_is_not_mirrored():
    """A sheared layout: the unseen half is continued instead, and marked so."""
    r = small_head(shown=lambda point: point[:, 0] > CENTRE[0] - 0.5)
    sheared = np.stack(
        [r.face.mesh.uv[:, 0] * 0.7 + 0.3 * r.face.mesh.uv[:, 1], r.face.mesh.uv[:, 1]], axis=1
    )
    atlas = bake(changed(r, {"face.mesh.uv": sheared.astype("f4")}), SIZE)
    levels = set(np.unique(atlas.confidence[: int(0.6 * SIZE)]))  # the skin's
    assert {DIFFUSED, BLENDED, SEEN} <= levels
    assert MIRRORED not in levels


def test_diffusion_keeps_a_constant_and_meets_the_boundary():
    """One colour all over stays that colour; a gradient has no step where the photo ends."""
    plain = small_head(albedo=lambda point: np.full((len(point), 3), 0.4), bend=0)
    atlas = bake(plain, SIZE)
    skin = atlas.confidence[: int(0.6 * SIZE)]
    assert {DIFFUSED, SEEN} <= set(np.unique(skin))
    np.testing.assert_allclose(atlas.diffuse_albedo[: int(0.6 * SIZE)], 0.4, atol=2e-3)
    half = small_head(
        albedo=lambda point: np.repeat(0.4 + 0.02 * (point - CENTRE)[:, 1:2], 3, axis=1),
        shown=lambda point: point[:, 1] > CENTRE[1] - 2,
    )
    atlas = bake(half, SIZE)
    column = slice(SIZE // 2 - 40, SIZE // 2 + 40)
    level, value = atlas.confidence[:, column], atlas.diffuse_albedo[:, column, 0]
    edge = (level[:-1] >= BLENDED) & (level[1:] == DIFFUSED)
    assert edge.any()
    assert np.abs(np.diff(value, axis=0))[edge].max() < 0.02


@pytest.mark.parametrize("shift", [0, 1, 2])
def test_eyes_take_no_skin_and_skin_no_eyes(shift):
    """Also where the segmentation of the eyes is off by two pixels."""
    r = small_head(eye_shift=shift, albedo=lambda point: np.full((len(point), 3), 0.5))
    atlas = bake(r, SIZE)
    eyes = np.zeros((SIZE, SIZE), bool)
    eyes[int(0.76 * SIZE) : int(0.94 * SIZE), int(0.06 * SIZE) : int(0.29 * SIZE)] = True
    assert (atlas.confidence[eyes] >= BLENDED).any()
    np.testing.assert_allclose(
        atlas.diffuse_albedo[eyes], np.tile(EYE_COLOUR, (eyes.sum(), 1)), atol=5e-3
    )
    np.testing.assert_allclose(atlas.diffuse_albedo[: int(0.6 * SIZE)], 0.5, atol=5e-3)


def test_closed_eyes_are_plain():
    """Eyeballs that the photo does not show are not painted with the lids in front of them."""
    r = small_head(albedo=lambda point: np.full((len(point), 3), 0.5))
    regions = np.zeros_like(r.photo.regions.weights)
    regions[..., 0] = 1
    atlas = bake(changed(r, {"photo.regions.weights": regions}), SIZE)
    ball = slice(int(0.8 * SIZE), int(0.9 * SIZE)), slice(int(0.1 * SIZE), int(0.2 * SIZE))
    assert (atlas.confidence[ball] == PLAIN).all()
    assert np.ptp(atlas.diffuse_albedo[ball].reshape(-1, 3), axis=0).max() < 1e-6


def bow(chart: tuple[float, float, float, float]) -> tuple[np.ndarray, ...]:
    """A row of teeth made up: half a ring that is open to the back, as `grid_ball`."""
    tube, triangles, uv, triangle_uv = grid_ball(15, 24, chart)
    angle = 0.5 * np.pi * tube[:, 1]
    row = np.stack([np.sin(angle), -0.3 * tube[:, 0], 1.5 * np.cos(angle)], axis=1)
    row[:, [0, 2]] *= 1 + 0.1 * tube[:, 2:]
    return 2 * row, triangles, uv, triangle_uv


def test_teeth_take_the_mouth_and_a_hidden_row_those_of_the_other():
    """One row before the face, taken for the open mouth, and one within the head."""
    r = small_head(albedo=lambda point: np.full((len(point), 3), 0.3), bend=0)
    mesh, tooth = r.face.mesh, np.array([0.6, 0.55, 0.4])
    rows = bow((0.7, 0.05, 0.82, 0.25)), bow((0.85, 0.05, 0.97, 0.25))
    vertices, triangles, uv, triangle_uv = (
        [array] for array in (mesh.vertices, mesh.triangles, mesh.uv, mesh.triangle_uv)
    )
    for row, place in zip(rows, ((0, -4, 9), (0, -4, 0)), strict=True):
        triangles.append(row[1] + sum(map(len, vertices)))
        triangle_uv.append(row[3] + sum(map(len, uv)))
        vertices.append(row[0] + CENTRE + place)
        uv.append(row[2])
    kinds = ("f4", "i4", "f4", "i4")
    joined = PosedMesh(
        *(
            np.concatenate(list_).astype(kind)
            for list_, kind in zip((vertices, triangles, uv, triangle_uv), kinds, strict=True)
        )
    )
    hits = Mesh(joined.vertices, joined.triangles).camera_hits(r.face.camera)
    row_pixels = hits.pixel.numpy()[hits.triangle.numpy() >= len(mesh.triangles)]
    regions, colour = r.photo.regions.weights.copy(), r.face.maps.diffuse_albedo.copy()
    regions.reshape(-1, 6)[row_pixels] = np.eye(6)[4]
    colour.reshape(-1, 3)[row_pixels] = tooth
    places = {"face.mesh": joined, "photo.regions.weights": regions}
    atlas = bake(changed(r, places | {"face.maps.diffuse_albedo": colour}), SIZE)
    inside = slice(int(0.78 * SIZE), int(0.92 * SIZE))
    for left, level in ((0.72, SEEN), (0.87, DIFFUSED)):
        chart = inside, slice(int(left * SIZE), int((left + 0.08) * SIZE))
        assert (atlas.confidence[chart] == level).any()
        np.testing.assert_allclose(atlas.diffuse_albedo[chart] - tooth, 0, atol=0.02)
    np.testing.assert_allclose(atlas.diffuse_albedo[: int(0.6 * SIZE)], 0.3, atol=5e-3)


def test_padding_has_no_seam(atlas):
    """Texels outside the layout repeat their nearest neighbour inside it."""
    rows, columns = np.mgrid[0:SIZE, 0:SIZE]
    u, v = (columns + 0.5) / SIZE, 1 - (rows + 0.5) / SIZE
    inside = (u > 0.02) & (u < 0.98) & (v > 0.369) & (v < 0.961)
    beside = ~inside & (v > 0.36) & (v < 0.97) & (u > 0.01) & (u < 0.99)
    tree = KDTree(np.argwhere(inside))
    nearest = np.argwhere(inside)[tree.query(np.argwhere(beside))[1]]
    difference = np.abs(atlas.diffuse_albedo[beside] - atlas.diffuse_albedo[tuple(nearest.T)])
    assert difference.max() < 0.01
    assert atlas.diffuse_albedo.min() > 0.05


def test_sizes_that_are_no_power_of_two():
    """Any size will do; all arrays have it, and every normal is a unit vector."""
    atlas = bake(small_head(48), 301)
    for name in ("diffuse_albedo", "specular_albedo", "roughness", "displacement", "confidence"):
        assert getattr(atlas, name).shape[:2] == (301, 301)
        assert np.isfinite(getattr(atlas, name)).all()
    for normal in (atlas.specular_normal, atlas.diffuse_normal):
        np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
        assert (normal[..., 2] > 0).all()


def test_eyes_that_were_not_seen_have_an_iris():
    """Behind dark glasses: a dark round iris and a white, marked as a guess."""
    r = small_head(albedo=lambda point: np.full((len(point), 3), 0.5))
    regions = np.zeros_like(r.photo.regions.weights)
    regions[..., 0] = 1
    place = r.face.mesh.vertices - CENTRE
    eyes = []
    for left, x in enumerate((-2.8, 2.8)):
        middle = np.array([x, 2.0, 7.9])
        ball = np.abs(np.linalg.norm(place - middle, axis=1) - 1.3) < 1e-3
        front = np.array([0.0, 0.0, 1.0])
        eyes.append(Eye(bool(left), ball, middle + CENTRE, 1.3, front, 0.33))
    atlas = bake(changed(r, {"photo.regions.weights": regions}), SIZE, eyes=tuple(eyes))
    row = int(0.85 * SIZE)
    for left in (0.05, 0.4):
        middle = int((left + 0.125) * SIZE)
        line = atlas.diffuse_albedo[row, middle : middle + int(0.1 * SIZE)].mean(axis=1)
        assert line[0] < 0.01 < line[4] < 0.1 < 0.45 < line[-1]  # pupil, iris, white
        chart = slice(int(0.8 * SIZE), int(0.9 * SIZE)), slice(middle - 40, middle + 40)
        assert (atlas.confidence[chart] == PLAIN).all()
