"""A beard, which is no skin, lies on the completed head as the photo has it."""

from dataclasses import dataclass

import numpy as np
import pytest

from changed import changed
from small_head import CENTRE, small_head
from unlit.face.reconstruction import Reconstruction
from unlit.output.atlas import BLENDED, MIRRORED, Atlas, bake
from unlit.output.beard import beard_of
from unlit.output.geometry import welded
from unlit.output.texels import texels_of
from unlit.perception.parser import CLASSES
from unlit.perception.topology import FACE_OVAL, NOSE_BASE
from unlit.scene.mesh import Mesh, surface

SIZE, PIXELS = 256, 96
SKIN, HAIR = np.array([0.5, 0.35, 0.3]), np.array([0.2, 0.18, 0.15])


def bearded(beard, hidden=lambda at: np.zeros(len(at), bool), share: float = 1.0):
    """The small head in one-sided light with a beard where `beard` says so of places (P, 3), cm
    from the head's middle; `hidden` places are neither skin nor beard."""
    r = small_head(
        PIXELS,
        albedo=lambda point: np.tile(SKIN, (len(point), 1)),
        bend=0,
        shown=lambda point: ~beard(point - CENTRE) & ~hidden(point - CENTRE),
    )
    mesh = Mesh(r.face.mesh.vertices, r.face.mesh.triangles)
    hits = mesh.camera_hits(r.face.camera)
    at, normal, _ = surface(r.face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    pixel, at, normal = hits.pixel.numpy(), at.numpy().T - CENTRE, normal.numpy().T
    hair = beard(at) & ~hidden(at)
    light = 0.6 + 0.35 * normal @ (0.8, 0.0, 0.6)
    image, shading = (np.zeros((PIXELS**2, 3), np.float32) for _ in range(2))
    image[pixel] = np.where(hair[:, None], HAIR, SKIN) * light[:, None]
    shading[pixel] = np.where(hair, 0, light)[:, None]
    normals, grid = np.zeros((PIXELS**2, 3), np.float32), np.zeros(PIXELS**2, np.float32)
    normals[pixel], grid[pixel] = normal, hair * share
    grid = np.kron(grid.reshape(PIXELS, PIXELS), np.ones((2, 2), np.float32))
    shares = np.zeros((192, 192, len(CLASSES)), np.float32)
    shares[..., CLASSES.index("beard")] = grid
    shares[..., CLASSES.index("skin")] = 1 - grid
    landmarks = np.zeros((478, 3))
    angles = np.linspace(0, 2 * np.pi, len(FACE_OVAL), endpoint=False)
    oval = np.stack([np.sin(angles), -np.cos(angles)], axis=1) * (30, 42)
    middle = r.face.camera.project(CENTRE[None])[0]
    landmarks[:, :2] = middle
    landmarks[list(FACE_OVAL), :2] = middle + oval
    landmarks[NOSE_BASE, :2] = middle + np.array([0.0, 4.0])
    places = {
        "photo.image": image.reshape(PIXELS, PIXELS, 3),
        "photo.landmarks": landmarks,
        "photo.regions.shares": shares,
        "images.diffuse_shading": shading.reshape(PIXELS, PIXELS, 3),
    }
    return changed(r, places), normals.reshape(PIXELS, PIXELS, 3)


def goatee(at: np.ndarray) -> np.ndarray:
    return (at[:, 1] < -3) & (at[:, 1] > -8) & (np.abs(at[:, 0]) < 3.5) & (at[:, 2] > 0)


@dataclass(frozen=True)
class Baked:
    """An atlas with the places (K, 3) of its texels, cm from the head's middle."""

    atlas: Atlas
    at: np.ndarray
    index: np.ndarray

    @staticmethod
    def of(r: Reconstruction, size: int = SIZE) -> "Baked":
        mesh = welded(r)
        texels = texels_of(mesh, size)
        return Baked(bake(r, size), texels.at(mesh.position, mesh.triangles) - CENTRE, texels.index)

    def where(self, rows: np.ndarray, name: str) -> np.ndarray:
        values = getattr(self.atlas, name)
        return values.reshape(-1, values[0, 0].size)[self.index[rows]]


def test_the_light_on_a_beard_is_divided_out():
    """One colour in light that falls off to a third across it: one albedo, and hardly any shine."""
    r, _ = bearded(goatee)
    found = Baked.of(r)
    x, y, z = found.at.T
    within = (np.abs(x) < 2.5) & (y > -6.5) & (y < -4) & (z > 4)
    assert within.sum() > 100
    np.testing.assert_allclose(
        found.where(within, "diffuse_albedo"), np.tile(HAIR, (within.sum(), 1)), rtol=0.08
    )
    assert (found.where(within, "confidence") == BLENDED).all()
    assert found.where(within, "specular_albedo").max() < 0.3
    assert found.where(within, "roughness").min() > 0.4


def test_a_beard_ends_softly_and_leaves_the_rest():
    """No step from texel to texel, nothing of it on cheeks, scalp and the back."""
    r, _ = bearded(goatee)
    size = 2 * SIZE
    found = Baked.of(r, size)
    chart = found.atlas.diffuse_albedo[: int(0.6 * size)]
    for axis in (0, 1):
        assert np.abs(np.diff(np.log(chart[..., 1]), axis=axis)).max() < 0.35
    far = (found.at[:, 1] > 1) | (found.at[:, 2] < -3)
    far &= found.where(np.arange(len(far)), "confidence")[:, 0] > 0
    skin = np.arange(len(far))[far & (found.index < int(0.6 * size) * size)]
    np.testing.assert_allclose(
        found.where(skin, "diffuse_albedo"), np.tile(SKIN, (len(skin), 1)), rtol=0.03
    )


def test_half_a_beard_is_mirrored():
    """The other half is behind a hand: it is as the one that is seen."""
    r, _ = bearded(goatee, hidden=lambda at: (at[:, 0] < -0.5) & (at[:, 1] < -1))
    found = Baked.of(r)
    x, y, z = found.at.T
    within = (x > -2.5) & (x < -1.2) & (y > -6) & (y < -4) & (z > 4)
    assert (found.where(within, "confidence") == MIRRORED).all()
    np.testing.assert_allclose(
        found.where(within, "diffuse_albedo"), np.tile(HAIR, (within.sum(), 1)), rtol=0.12
    )


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_stubble_is_skin(share):
    """What the parser hardly takes for a beard stays to the stages; so where it was not asked."""
    r, normals = bearded(goatee, share=share)
    everywhere = np.ones((PIXELS, PIXELS), bool)
    assert beard_of(r, normals, everywhere, 4.0) is None
    unasked = changed(bearded(goatee)[0], {"photo.regions.shares": None})
    assert beard_of(unasked, normals, everywhere, 4.0) is None
