"""Mitsuba 3 scenes: the face, the photo's light and camera, as XML.

`scene.xml` needs Mitsuba's own plugins only. Its material is the model of scene/brdf.py to the
letter: a `blendbsdf` of equal halves adds a `diffuse` and a `roughconductor` (Beckmann) of twice
the reflectance each, both in a `normalmap` of their own. A conductor without absorption
(k = 0) has the Fresnel reflectance of a dielectric. Of the `normalmap`s' two repairs the shadowing
function is off, as our model has none, and so is the turning round of a specular normal that faces
away from the viewer, where our lobe is zero. A diffuse normal that faces away is turned round: off,
the skin there would be black, while ours goes on. Elsewhere only the atlas differs from our
renders: the texels, and the filled parts of it.

`scene_unlit.xml` has the maps as they are, projected from the crop's pixels, by the plugin
`unlit_result`, which `import unlit.output.mitsuba_scene` makes known to Mitsuba.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba
from ..render.reference import FaceBSDF, mitsuba_environment
from ..scene.brdf import IOR

mi = mitsuba()

PLUGIN = "unlit_result"
ENVIRONMENT = "mitsuba_environment.exr"
TWICE_DIFFUSE, TWICE_SPECULAR = "mitsuba_diffuse_x2.exr", "mitsuba_specular_x2.exr"
_SAMPLES, _BOUNCES = 256, 3


class ResultBSDF(FaceBSDF):
    """The reflectance of a saved reconstruction; `folder`: where it is, relative to the scene."""

    def __init__(self, props: Any) -> None:
        from .load import load

        super().__init__(props)
        r = load(Path(str(mi.file_resolver().resolve(props["folder"]))))
        self.set_maps(r.face.camera, r.face.maps)


mi.register_bsdf(PLUGIN, ResultBSDF)


def environment(reconstruction: Reconstruction) -> np.ndarray:
    """(721, 1440, 3) radiance of the light, sampled as Mitsuba's `envmap` interpolates it."""
    return np.array(mitsuba_environment(reconstruction.light.environment))


def stock_scene(reconstruction: Reconstruction, mesh: str) -> bytes:
    """scene.xml; mesh: the PLY file's name."""
    bsdf = ElementTree.Element("bsdf", type="blendbsdf")
    _put(bsdf, "float", "weight", 0.5)
    diffuse = _bent(bsdf, "atlas_diffuse_normal.exr", "diffuse", flip=True)
    _texture(diffuse, "reflectance", TWICE_DIFFUSE)
    lobe = _bent(bsdf, "atlas_specular_normal.exr", "roughconductor", flip=False)
    _put(lobe, "string", "distribution", "beckmann")
    _put(lobe, "spectrum", "eta", IOR)
    _put(lobe, "spectrum", "k", 0.0)
    _texture(lobe, "alpha", "atlas_roughness.exr")
    _texture(lobe, "specular_reflectance", TWICE_SPECULAR)
    return _scene(reconstruction, mesh, bsdf)


def own_scene(reconstruction: Reconstruction, mesh: str, folder: str) -> bytes:
    """scene_unlit.xml; folder: path of the saved reconstruction, from the scene."""
    bsdf = ElementTree.Element("bsdf", type=PLUGIN)
    _put(bsdf, "string", "folder", folder)
    return _scene(reconstruction, mesh, bsdf)


def _scene(r: Reconstruction, mesh: str, bsdf: ElementTree.Element) -> bytes:
    scene = ElementTree.Element("scene", version="3.0.0")
    integrator = ElementTree.SubElement(scene, "integrator", type="path")
    _put(integrator, "integer", "max_depth", _BOUNCES + 2)
    _put(integrator, "boolean", "hide_emitters", "true")
    scene.append(_sensor(r))
    light = ElementTree.SubElement(scene, "emitter", type="envmap")
    _put(light, "string", "filename", ENVIRONMENT)
    shape = ElementTree.SubElement(scene, "shape", type="ply")
    _put(shape, "string", "filename", mesh)
    _put(shape, "boolean", "flip_tex_coords", "true")  # v of Mitsuba's bitmaps points down
    shape.append(bsdf)
    ElementTree.indent(scene)
    return ElementTree.tostring(scene, encoding="utf-8", xml_declaration=True) + b"\n"


def _sensor(r: Reconstruction) -> ElementTree.Element:
    """The camera of scene/camera.py: the same numbers as Camera.mitsuba_sensor."""
    given = r.face.camera.mitsuba_sensor(_SAMPLES)
    sensor = ElementTree.Element("sensor", type=given["type"])
    offsets = ("principal_point_offset_x", "principal_point_offset_y")
    for name in ("fov", *offsets, "near_clip", "far_clip"):
        _put(sensor, "float", name, given[name])
    _put(sensor, "string", "fov_axis", given["fov_axis"])
    transform = ElementTree.SubElement(sensor, "transform", name="to_world")
    ElementTree.SubElement(transform, "lookat", origin="0, 0, 0", target="0, 0, -1", up="0, 1, 0")
    sampler = ElementTree.SubElement(sensor, "sampler", type="independent")
    _put(sampler, "integer", "sample_count", _SAMPLES)
    film = ElementTree.SubElement(sensor, "film", type="hdrfilm")
    _put(film, "integer", "width", r.face.camera.width)
    _put(film, "integer", "height", r.face.camera.height)
    _put(film, "string", "pixel_format", "rgb")
    ElementTree.SubElement(film, "rfilter", type="box")
    return sensor


def _bent(parent: ElementTree.Element, normals: str, kind: str, flip: bool) -> ElementTree.Element:
    """A BSDF of `kind` inside a `normalmap`; flip: turn round normals that face away."""
    outer = ElementTree.SubElement(parent, "bsdf", type="normalmap")
    _put(outer, "boolean", "use_shadowing_function", "false")
    _put(outer, "boolean", "flip_invalid_normals", str(flip).lower())
    _texture(outer, "normalmap", normals)
    return ElementTree.SubElement(outer, "bsdf", type=kind)


def _texture(parent: ElementTree.Element, name: str, file: str) -> None:
    bitmap = ElementTree.SubElement(parent, "texture", type="bitmap", name=name)
    _put(bitmap, "string", "filename", file)
    _put(bitmap, "boolean", "raw", "true")
    _put(bitmap, "string", "wrap_mode", "clamp")


def _put(parent: ElementTree.Element, kind: str, name: str, value: object) -> None:
    ElementTree.SubElement(parent, kind, name=name, value=str(value))
