"""The head on its turntable."""

from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from small_head import CENTRE, small_head, symmetric_albedo
from unlit.relighting.pose import Turntable
from unlit.scene.mesh import Mesh, surface

SIZE = 64


@cache
def table() -> Turntable:
    return Turntable(small_head(SIZE))


def test_not_turned() -> None:
    """At 0 degrees the maps are the result's own, as far as the atlas keeps them."""
    face, seen = table().face, table().turned(0)
    inside = ndimage.binary_erosion(
        (face.face.mask > 0) & (face.photo.regions.weights[..., 2] == 0), iterations=3
    )
    assert seen.mesh.vertices == pytest.approx(face.face.mesh.vertices, abs=1e-5)
    assert (seen.mask[face.face.mask > 0] == 1).all()
    for name in ("diffuse_albedo", "specular_albedo", "roughness"):
        ours, theirs = getattr(seen.maps, name)[inside], getattr(face.face.maps, name)[inside]
        assert np.abs(ours - theirs).mean() < 0.005 * theirs.mean()
    for name in ("specular", "diffuse"):
        cosine = (getattr(seen.normals, name) * getattr(face.face.normals, name)).sum(axis=-1)[
            inside
        ]
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 0.5


@pytest.mark.parametrize("degrees", [-30.0, 25.0])
def test_turned(degrees: float) -> None:
    """The nose goes the right way, and every point of the skin keeps its own albedo."""
    face, seen = table().face, table().turned(degrees)
    middle = 0.5 * (face.face.mesh.vertices.min(axis=0) + face.face.mesh.vertices.max(axis=0))
    nose = face.face.mesh.vertices[:, 2].argmax()
    assert np.sign(seen.mesh.vertices[nose, 0] - middle[0]) == np.sign(degrees)
    # An independent truth: the albedo is a known function of the point before the turn.
    mesh = Mesh(seen.mesh.vertices, seen.mesh.triangles)
    hits = mesh.camera_hits(face.face.camera)
    at = surface(face.face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles)[0].numpy().T
    a = np.radians(-degrees)
    back = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    before = (at - middle) @ back.T + middle
    skin = (before[:, 2] - CENTRE[2] > 4) & (np.abs(before[:, 1] - CENTRE[1] - 2) > 2.5)
    pixel = hits.pixel.numpy()[skin]
    ours = seen.maps.diffuse_albedo.reshape(-1, 3)[pixel]
    assert np.abs(ours - symmetric_albedo(before[skin])).mean() < 0.01
    lengths = np.linalg.norm(seen.normals.specular.reshape(-1, 3)[pixel], axis=1)
    assert lengths == pytest.approx(1, abs=1e-4)


def test_once_round() -> None:
    """After a whole turn the head is where it was."""
    there, back = table().turned(0), table().turned(360)
    assert back.mesh.vertices == pytest.approx(there.mesh.vertices, abs=1e-4)
    assert (back.mask != there.mask).mean() < 1e-3
