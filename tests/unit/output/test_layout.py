"""Texture layouts: the face gets most of the square, and nothing is folded, torn or lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from changed import changed
from small_head import SKIN_TRIANGLES, small_head, with_outline
from unlit.face.reconstruction import Reconstruction
from unlit.head.model import HeadModel
from unlit.output.atlas import BLENDED, MIRRORED, bake
from unlit.output.layout import LARGEST, LAYOUTS, SMALLEST, atlas_size, laid_out
from unlit.output.parts import EYES, INSIDE, TEETH, components, mirror_axis, parts
from unlit.perception.topology import FACE_OVAL


def on_model(head: HeadModel) -> Reconstruction:
    """The default head model as a result: its mesh and landmarks; the maps are another's."""
    r = small_head(32)
    mesh = replace(
        r.face.mesh,
        vertices=head.neutral,
        triangles=head.triangles,
        uv=head.uv,
        triangle_uv=head.triangle_uv,
    )
    return changed(
        r, {"face.mesh": mesh, "head.mesh": mesh, "head.landmark_points": head.landmark_points}
    )


def areas(uv: np.ndarray, triangle_uv: np.ndarray) -> np.ndarray:
    a, b, c = (uv[triangle_uv[:, i]].astype(np.float64) for i in range(3))
    ab, ac = b - a, c - a
    return (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2


def outline_share(r: Reconstruction) -> float:
    """Area inside the landmarks of the face's outline, of the square."""
    points, oval = r.head.landmark_points, np.asarray(FACE_OVAL)
    corners = r.face.mesh.uv[r.face.mesh.triangle_uv[points.triangle[oval]]]
    x, y = (corners * points.barycentric[oval][..., None]).sum(axis=1).T
    return abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) / 2


def test_the_default_head_has_its_face_on_two_fifths_of_the_square(head) -> None:
    """Four times as much as in its own layout; with the neck and the rim it is half."""
    own = on_model(head)
    assert outline_share(own) < 0.1
    assert outline_share(laid_out(own, "face")) > 0.4


def test_no_triangle_is_turned_over_or_lost_and_charts_stay_apart(head) -> None:
    own = on_model(head)
    mesh = laid_out(own, "face").face.mesh
    before, after = areas(own.face.mesh.uv, mesh.triangle_uv), areas(mesh.uv, mesh.triangle_uv)
    real = np.abs(before) > 1e-10
    assert (np.sign(before) == np.sign(after))[real].all()
    assert (after / before)[real].min() > 1 / 150
    assert mesh.uv.min() >= 0.004
    assert mesh.uv.max() <= 0.996
    chart = components(mesh.triangle_uv, len(mesh.uv))
    low, high = (
        np.array([extreme(mesh.uv[chart == k], axis=0) for k in np.unique(chart)])
        for extreme in (np.min, np.max)
    )
    for i in range(len(low)):
        for j in range(i):
            gap = np.maximum(low[i] - high[j], low[j] - high[i]).max()
            assert gap > 0.009


def test_the_mirror_axis_stays_and_eyes_are_not_smaller(head) -> None:
    own = on_model(head)
    mesh = laid_out(own, "face").face.mesh
    part = parts(mesh.vertices, mesh.triangles, mesh.triangle_uv)
    chart = components(mesh.triangle_uv, len(mesh.uv))
    main = np.bincount(chart).argmax() == chart[mesh.triangle_uv[:, 0]]
    assert mirror_axis(mesh.uv, mesh.triangle_uv[main]) == pytest.approx(0.5, abs=1e-6)
    before, after = (np.abs(areas(uv, mesh.triangle_uv)) for uv in (own.face.mesh.uv, mesh.uv))
    assert after[part == EYES].sum() > 1.5 * before[part == EYES].sum()
    hidden = np.isin(part, (INSIDE, TEETH))
    assert after[hidden].sum() > 0.25 * before[hidden].sum()
    assert after[part == TEETH].sum() > 0.5 * before[part == TEETH].sum()  # smiles show them


def test_other_layouts_are_left_alone() -> None:
    """The head's own on request, and where no landmark says where the face is."""
    r = small_head(32)
    for layout in LAYOUTS:
        assert laid_out(r, layout).face.mesh.uv is r.face.mesh.uv
    outlined = with_outline(r)
    assert laid_out(outlined, "head").face.mesh.uv is r.face.mesh.uv
    assert not np.array_equal(laid_out(outlined, "face").face.mesh.uv, r.face.mesh.uv)


def test_the_baked_face_has_more_texels_of_the_same_picture() -> None:
    """Measured and mirrored texels are where the mesh says, with the colours that they had."""
    hidden = with_outline(small_head(shown=lambda point: point[:, 0] > -0.2))
    own, face = (bake(laid_out(hidden, layout), 256) for layout in ("head", "face"))
    assert (face.confidence >= BLENDED).mean() > 1.5 * (own.confidence >= BLENDED).mean()
    assert (face.confidence == MIRRORED).sum() > 1000
    same = np.unique(hidden.face.mesh.triangle_uv[:SKIN_TRIANGLES])
    looked = []
    for atlas, layout in ((own, "head"), (face, "face")):
        u, v = laid_out(hidden, layout).face.mesh.uv[same].T
        cell = ((1 - v) * 256).astype(int).clip(0, 255), (u * 256).astype(int).clip(0, 255)
        looked.append((atlas.diffuse_albedo[cell], atlas.confidence[cell]))
    (colour, level), (other, found) = looked
    both = (level >= MIRRORED) & (found >= MIRRORED)
    assert both.mean() > 0.15
    assert np.abs(colour - other)[both].mean() < 0.01


@pytest.mark.parametrize(("pixels", "size"), [(96, 512), (256, 512), (512, 1024), (640, 2048)])
def test_the_size_follows_the_crop(pixels, size) -> None:
    r = small_head(32)
    assert atlas_size(changed(r, {"photo.image": np.zeros((pixels, pixels, 3))})) == size
    wide = changed(r, {"photo.image": np.zeros((9000, 1, 3))})
    assert atlas_size(wide) == LARGEST == 8 * SMALLEST
