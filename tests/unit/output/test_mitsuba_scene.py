"""The Mitsuba scenes render what our own path tracer renders."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from small_head import save_quickly, small_head
from unlit._runtime import mitsuba
from unlit.color import encode_srgb
from unlit.output import export, save
from unlit.reconstruction import Reconstruction
from unlit.render.reference import path_trace
from unlit.scene.maps import Maps
from unlit.scene.mesh import Mesh

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

    inner = binary_erosion(inside, iterations=3)
    a, b = (uniform_filter(encode_srgb(np.clip(x, 0, 1)), (5, 5, 0)) for x in (a, b))
    return float(-10 * np.log10(((a - b)[inner] ** 2).mean()))


@pytest.mark.parametrize("name", ["scene.xml", "scene_unlit.xml"])
def test_renders_as_ours(r, folder, name):
    """Stock plugins on the atlas, and our plugin on the maps: 40 dB of our path tracer."""
    scene = mi.load_file(str(folder / name))
    sensor = mi.load_dict(r.camera.mitsuba_sensor(SAMPLES))
    theirs = mi.render(scene, sensor=sensor).numpy()[..., :3]
    maps = Maps(r.diffuse_albedo, r.specular_albedo, r.roughness, r.perturbation)
    ours = path_trace(
        Mesh(r.vertices, r.triangles), r.camera, maps, r.light.rasterize(), SAMPLES, bounces=3
    )
    assert filtered_difference(ours, theirs, r.mask > 0) > 40
    camera = scene.sensors()[0]
    assert tuple(camera.film().size()) == (r.camera.width, r.camera.height)


def test_the_scenes_camera_is_the_photos(r, folder):
    """The file's own sensor sees the mesh at the same pixels."""
    sensor = mi.load_file(str(folder / "scene.xml")).sensors()[0]
    ours = mi.load_dict(r.camera.mitsuba_sensor(1))
    for sample in ((0.1, 0.2), (0.5, 0.5), (0.9, 0.7)):
        rays = [
            s.sample_ray(0.0, 0.0, mi.Point2f(*sample), mi.Point2f(0.5))[0] for s in (sensor, ours)
        ]
        np.testing.assert_allclose(rays[0].d.numpy(), rays[1].d.numpy(), atol=1e-6)


def test_only_stock_plugins_and_files_that_are_there(folder):
    """scene.xml names no plugin of ours and only files beside it."""
    tree = ElementTree.parse(folder / "scene.xml")
    kinds = {element.get("type") for element in tree.iter()} - {None}
    assert not any(kind.startswith("unlit") for kind in kinds if kind)
    files = [e.get("value") for e in tree.iter("string") if e.get("name") == "filename"]
    assert len(files) == 7
    for file in files:
        assert (folder / str(file)).is_file()
