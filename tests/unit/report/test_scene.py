"""The viewer's scene: unpacked as the browser does, it is the mesh, its shadows and the light."""

import base64
import json
import zlib

import numpy as np
import pytest

from small_head import CENTRE
from unlit.report.scene import material, scene
from unlit.scene.light import latlong_directions, latlong_solid_angles


@pytest.fixture(scope="module")
def unpacked(face, atlas):
    packed = scene(face, atlas)
    numbers = json.loads(packed.numbers)
    binary = zlib.decompress(base64.b64decode(packed.arrays))
    arrays = {
        name: np.frombuffer(binary, f"<{entry['kind']}", entry["length"], entry["offset"])
        for name, entry in numbers["arrays"].items()
    }
    return numbers, arrays


def test_positions_and_triangles_are_the_mesh(unpacked, face):
    """To a hundredth of a millimetre, at the corners of each triangle."""
    numbers, arrays = unpacked
    at = arrays["position"].reshape(-1, 3) / 65535 * numbers["extent"] + numbers["low"]
    corners = at[arrays["triangles"].reshape(-1, 3)]
    assert np.abs(corners - face.face.mesh.vertices[face.face.mesh.triangles]).max() < 1e-3


def test_offsets_suit_every_type(unpacked):
    numbers, _ = unpacked
    assert all(entry["offset"] % 4 == 0 for entry in numbers["arrays"].values())


def test_a_sphere_sees_the_sky_above_its_horizon(unpacked):
    """The top of the head is convex: it sees what is above its horizon, and nothing below."""
    _, arrays = unpacked
    normal = arrays["normal"].reshape(-1, 3) / 32767
    bits = np.unpackbits(
        arrays["visibility"].view(np.uint8).reshape(648, -1), axis=1, bitorder="little"
    )
    vertex = int(normal[:, 1].argmax())
    cosine = latlong_directions(18, 36).reshape(-1, 3) @ normal[vertex]
    assert bits[cosine > 0.1, vertex].all()
    assert not bits[cosine < -0.1, vertex].any()
    assert arrays["hidden"][vertex] <= 3


def test_what_lies_inside_the_head_sees_nothing(unpacked):
    """The backs of the eyeballs are under the skin, an ellipsoid with known half-axes."""
    numbers, arrays = unpacked
    at = arrays["position"].reshape(-1, 3) / 65535 * numbers["extent"] + numbers["low"]
    depth = (((at - CENTRE) / (0.85, 1.1, 1.0)) ** 2).sum(axis=1)
    inside = depth < 0.8 * 81
    assert inside.sum() > 50
    assert (arrays["hidden"][inside] >= 250).all()


def test_the_light_keeps_its_power(unpacked, face):
    """The grid's flux is that of the Gaussians, integrated much more finely."""
    _, arrays = unpacked
    grid = arrays["light photo"].reshape(36, 72, 3)
    flux = (grid * latlong_solid_angles(36, 72)[..., None]).sum(axis=(0, 1))
    fine = face.light.radiance(latlong_directions(300, 600)) * latlong_solid_angles(300, 600)
    np.testing.assert_allclose(flux, fine.sum(), rtol=0.002)


def test_material_channels(atlas):
    pixels = material(atlas) / 255
    np.testing.assert_allclose(2 * pixels[..., 0], np.clip(atlas.specular_albedo, 0, 2), atol=5e-3)
    np.testing.assert_allclose(pixels[..., 1] ** 2, atlas.roughness, atol=5e-3)
    np.testing.assert_array_equal(np.rint(255 * pixels[..., 2]), atlas.confidence)
