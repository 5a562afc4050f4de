"""The Mitsuba scenes render what our own path tracer renders."""

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from small_head import save_quickly, small_head
from unlit.color import encode_srgb
from unlit.face.reconstruction import Reconstruction
from unlit.machine.runtime import mitsuba
from unlit.output.export import export
from unlit.output.mitsuba_scene import TWICE_DIFFUSE, TWICE_SPECULAR
from unlit.output.save import save
from unlit.render.reference import path_trace
from unlit.scene.brdf import specular
from unlit.scene.mesh import Mesh

# isort: split
import drjit as dr

mi = mitsuba()
SAMPLES = 64


@pytest.fixture(scope="module")
def r() -> Reconstruction:
    return small_head(96)


@pytest.fixture(scope="module")
def folder(r, tmp_path_factory) -> Path:
    source = tmp_path_factory.mktemp("result")
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(r, source)
    return export(r, source / "export", source, ["mitsuba"], 512)


def filtered_difference(a: np.ndarray, b: np.ndarray, inside: np.ndarray) -> float:
    """PSNR after a 5 x 5 box filter, which takes most of the noise off both."""
    from scipy.ndimage import binary_erosion, uniform_filter

    inner = np.asarray(binary_erosion(inside, iterations=3), bool)
    a, b = (uniform_filter(encode_srgb(np.clip(x, 0, 1)), 5, axes=(0, 1)) for x in (a, b))
    return float(-10 * np.log10(((a - b)[inner] ** 2).mean()))


@pytest.mark.parametrize("name", ["scene.xml", "scene_unlit.xml"])
def test_renders_as_ours(r, folder, name):
    """Stock plugins on the atlas, and our plugin on the maps: 40 dB of our path tracer."""
    scene = mi.load_file(str(folder / name))
    sensor = mi.load_dict(r.face.camera.mitsuba_sensor(SAMPLES))
    theirs = mi.render(scene, sensor=sensor).numpy()[..., :3]
    ours = path_trace(
        Mesh(r.face.mesh.vertices, r.face.mesh.triangles),
        r.face.camera,
        r.face.maps,
        r.light.rasterize(),
        SAMPLES,
        bounces=3,
    )
    assert filtered_difference(ours, theirs, r.face.mask > 0) > 40
    camera = scene.sensors()[0]
    assert tuple(camera.film().size()) == (r.face.camera.width, r.face.camera.height)


def test_the_scenes_camera_is_the_photos(r, folder):
    """The file's own sensor sees the mesh at the same pixels."""
    sensor = mi.load_file(str(folder / "scene.xml")).sensors()[0]
    ours = mi.load_dict(r.face.camera.mitsuba_sensor(1))
    for sample in ((0.1, 0.2), (0.5, 0.5), (0.9, 0.7)):
        rays = [
            s.sample_ray(0.0, 0.0, mi.Point2f(*sample), mi.Point2f(0.5))[0] for s in (sensor, ours)
        ]
        np.testing.assert_allclose(rays[0].d.numpy(), rays[1].d.numpy(), atol=1e-6)


def interaction(viewer: float) -> Any:
    """The middle of a texture on the xy plane, seen `viewer` degrees from z towards x."""
    si = dr.zeros(mi.SurfaceInteraction3f, 1)
    si.uv = mi.Point2f(0.5)
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    si.wi = direction(viewer)
    return si


def direction(degrees: float) -> Any:
    return mi.Vector3f(math.sin(math.radians(degrees)), 0, math.cos(math.radians(degrees)))


@pytest.mark.parametrize(
    ("viewer", "light", "diffuse"),
    [(70, 80, 0.4), (-20, 85, 0.4), (30, -60, 0.4), (10, -72, 0.4), (-80, 30, 0.0)],
)
def test_the_material_is_our_model_at_a_bent_normal(folder, tmp_path, viewer, light, diffuse):
    """The BSDF of scene.xml with both normals bent by 17 degrees: scene/brdf.py's value.

    At grazing light Mitsuba's shadowing function, on by default, would darken it; in the last
    case the viewer is behind the normal: no specular lobe (the diffuse one is turned, so left out).
    """
    bend, alpha, specular_albedo = 17.0, 0.3, 0.8
    normal = direction(bend)
    encoded = 0.5 + 0.5 * np.ravel(normal.numpy())
    for file, value in {
        "atlas_diffuse_normal.exr": encoded,
        "atlas_specular_normal.exr": encoded,
        "atlas_roughness.exr": [alpha],
        TWICE_DIFFUSE: [2 * diffuse] * 3,
        TWICE_SPECULAR: [2 * specular_albedo],
    }.items():
        pixels = np.tile(np.asarray(value, np.float32), (2, 2, 1))
        mi.Bitmap(pixels).write(str(tmp_path / file))
    root = ElementTree.parse(folder / "scene.xml").getroot()
    material = root.find("shape/bsdf")
    assert material is not None
    scene = ElementTree.Element("scene", version="3.0.0")
    ElementTree.SubElement(scene, "shape", type="rectangle").append(material)
    (tmp_path / "scene.xml").write_bytes(ElementTree.tostring(scene))
    bsdf = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].bsdf()
    si = interaction(viewer)
    wo = direction(light)
    theirs = bsdf.eval(mi.BSDFContext(), si, wo).numpy().ravel()[0]
    ours = diffuse / np.pi * max(math.cos(math.radians(light - bend)), 0)
    ours += specular_albedo * specular(normal, wo, si.wi, mi.Float(alpha)).numpy()[0]
    assert theirs == pytest.approx(ours, rel=1e-3, abs=1e-6)


def test_only_stock_plugins_and_files_that_are_there(folder):
    """scene.xml names no plugin of ours and only files beside it."""
    tree = ElementTree.parse(folder / "scene.xml")
    kinds = {element.get("type") for element in tree.iter()} - {None}
    assert not any(kind.startswith("unlit") for kind in kinds if kind)
    files = [e.get("value") for e in tree.iter("string") if e.get("name") == "filename"]
    assert len(files) == 7
    for file in files:
        assert (folder / str(file)).is_file()
