"""face.glb, read back by others: Khronos' validator, trimesh, and Mitsuba as the renderer."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from khronos import issues_of
from small_head import CENTRE, small_head
from unlit.color import decode_srgb, encode_srgb
from unlit.face.reconstruction import Reconstruction
from unlit.machine.runtime import mitsuba
from unlit.output.atlas import Atlas, bake
from unlit.output.gltf import glb, specular_texture
from unlit.render.reference import mitsuba_environment, path_trace
from unlit.scene.camera import Camera
from unlit.scene.mesh import Mesh

mi = mitsuba()


@pytest.fixture(scope="module")
def r() -> Reconstruction:
    return small_head(128)


@pytest.fixture(scope="module")
def atlas(r) -> Atlas:
    return bake(r, 512)


@pytest.fixture(scope="module")
def file(r, atlas, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("glb") / "face.glb"
    path.write_bytes(glb(r, atlas))
    return path


def document(file: Path) -> dict:
    data = file.read_bytes()
    assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data))
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length])


def node(found: dict, name: str) -> dict:
    return next(one for one in found["nodes"] if one["name"] == name)


def test_khronos_validator(file):
    """No errors, no warnings, not even hints. Needs node and the npm package gltf-validator."""
    assert issues_of(file) == [0, 0, 0, 0]


def test_materials_say_skin(file):
    """Index of refraction, the two extensions, and a material for each part that is there."""
    found = document(file)
    assert sorted(found["extensionsUsed"]) == ["KHR_materials_ior", "KHR_materials_specular"]
    assert [material["name"] for material in found["materials"]] == ["skin", "eyes"]
    for material in found["materials"]:
        assert material["extensions"]["KHR_materials_ior"] == {"ior": 1.38}
        assert material["pbrMetallicRoughness"]["metallicFactor"] == 0


def test_camera_axes_and_metres(r, file):
    """Through the file's own camera the mesh lands on the photo's pixels, in metres, y up."""
    trimesh = pytest.importorskip("trimesh")
    found = document(file)
    lens = found["cameras"][0]["perspective"]
    film, crop = (found["cameras"][0]["extras"][name] for name in ("film", "crop"))
    place = np.array(node(found, "photo camera")["translation"])
    vertices = np.concatenate([g.vertices for g in trimesh.load(file).dump()])
    assert np.ptp(vertices[:, 1]) == pytest.approx(
        np.ptp(r.face.mesh.vertices[:, 1]) / 100, rel=1e-4
    )
    local = vertices - place
    assert (local[:, 2] < 0).all()  # glTF's cameras look along -z, y up
    half = np.tan(lens["yfov"] / 2)
    ndc = local[:, :2] / -local[:, 2:] / (half * lens["aspectRatio"], half)
    pixel = (0.5 + ndc * (0.5, -0.5)) * film - crop[:2]
    expected = r.face.camera.project((vertices - place) * 100)
    np.testing.assert_allclose(pixel, expected, atol=0.01)
    nose = vertices[vertices[:, 2].argmax()]
    assert abs(nose[0] - (CENTRE[0] - r.face.mesh.vertices[:, 0].mean()) / 100) < 0.01


def test_specular_above_one():
    """Up to 1 in alpha, above in the sRGB-encoded colour times its factor."""
    albedo = np.array([[0.0, 0.4], [1.0, 2.5]])
    texture, factor = specular_texture(albedo)
    value = texture / 255.0
    assert factor == 2.5
    product = value[..., 3] * decode_srgb(value[..., 0]) * factor
    np.testing.assert_allclose(product, albedo, atol=0.02)


def rendered(file: Path, camera: Camera, environment: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """The file as trimesh reads it, with glTF's material, path-traced from the photo's camera.

    From the glTF 2.0 specification: diffuse plus GGX with alpha = roughness squared; Mitsuba's
    roughconductor with k = 0 has the Fresnel reflectance of the index of refraction.
    """
    trimesh = pytest.importorskip("trimesh")
    specular = document(file)["materials"][0]["extensions"]["KHR_materials_specular"]
    factor = specular["specularColorFactor"][0]

    def texture(pixels: np.ndarray) -> dict:
        pixels = np.ascontiguousarray(pixels, dtype=np.float32)
        return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True}

    scene: dict = {
        "type": "scene",
        "light": {"type": "envmap", "bitmap": mitsuba_environment(environment)},
    }
    images = images_of(file)
    lobe = images[specular["specularTexture"]["index"]] / 255.0
    strength = lobe[..., 3:] * decode_srgb(lobe[..., :1]) * factor
    for index, part in enumerate(trimesh.load(file).dump()):
        material = part.visual.material
        colour = decode_srgb(np.asarray(material.baseColorTexture.convert("RGB")) / 255)
        rough = np.asarray(material.metallicRoughnessTexture)[..., 1:2] / 255
        normal = np.asarray(material.normalTexture.convert("RGB")) / 255
        bsdf = {
            "type": "normalmap",
            "use_shadowing_function": False,  # glTF has none
            "normalmap": texture(normal),
            "both": {
                "type": "blendbsdf",
                "weight": 0.5,
                "diffuse": {"type": "diffuse", "reflectance": texture(2 * colour)},
                "lobe": {
                    "type": "roughconductor",
                    "distribution": "ggx",
                    "alpha": texture(rough**2),
                    "eta": 1.38,
                    "k": 0.0,
                    "specular_reflectance": texture(2 * strength),
                },
            },
        }
        props = mi.Properties()
        props["mesh_bsdf"] = mi.load_dict(bsdf)
        mesh = mi.Mesh("part", len(part.vertices), len(part.faces), props, True, True)
        parameters = mi.traverse(mesh)
        # trimesh turns v up; Mitsuba's bitmaps have it down.
        uv = np.asarray(part.visual.uv) * (1, -1) + (0, 1)
        for name, values in (
            ("vertex_positions", part.vertices * 100 + centre),
            ("vertex_normals", part.vertex_normals),
            ("vertex_texcoords", uv),
        ):
            parameters[name] = np.asarray(values, dtype=np.float32).ravel()
        parameters["faces"] = np.asarray(part.faces, dtype=np.uint32).ravel()
        parameters.update()
        scene[f"part{index}"] = mesh
    integrator = mi.load_dict({"type": "path", "max_depth": 3, "hide_emitters": True})
    sensor = mi.load_dict(camera.mitsuba_sensor(96))
    return mi.render(mi.load_dict(scene), sensor=sensor, integrator=integrator).numpy()[..., :3]


def images_of(file: Path) -> list[np.ndarray]:
    """The pixels of every image in the file."""
    import io

    from PIL import Image

    found, data = document(file), file.read_bytes()
    binary = data[20 + struct.unpack("<I", data[12:16])[0] + 8 :]
    views = [found["bufferViews"][image["bufferView"]] for image in found["images"]]
    return [
        np.asarray(Image.open(io.BytesIO(binary[v["byteOffset"] :][: v["byteLength"]])))
        for v in views
    ]


def test_rendered_by_others_it_is_the_same_face(r, file):
    """Within 30 dB of our path-traced render under a lamp and a sky, where the photo saw it."""
    environment = r.light.rasterize()
    ours = path_trace(
        Mesh(r.face.mesh.vertices, r.face.mesh.triangles),
        r.face.camera,
        r.face.maps,
        environment,
        96,
    )
    place = np.array(node(document(file), "photo camera")["translation"])
    theirs = rendered(file, r.face.camera, environment, -100 * place)
    inside = r.face.mask > 0
    error = encode_srgb(np.clip(ours, 0, 1)) - encode_srgb(np.clip(theirs, 0, 1))
    assert -10 * np.log10((error[inside] ** 2).mean()) > 30
    assert ours[inside].mean() == pytest.approx(theirs[inside].mean(), rel=0.02)
