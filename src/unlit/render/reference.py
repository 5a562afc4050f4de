"""The path-traced reference: the same mesh, reflectance and light in Mitsuba's `path` integrator.

The BSDF plugin `unlit_face` has two normals (diffuse and specular) and textures that are
projected through the camera. Of stock plugins a `blendbsdf` of two `normalmap`s expresses the same
model on texture coordinates (output/mitsuba_scene.py, docs/outputs.md); this plugin is for maps
projected from the crop.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..progress.callbacks import PassProgress, silent
from ..scene.arrays import at_least
from ..scene.brdf import specular
from ..scene.camera import Camera
from ..scene.maps import Maps
from ..scene.mesh import Mesh

mi = mitsuba()

PLUGIN = "unlit_face"


class FaceBSDF(mi.BSDF):
    """Lambert + Beckmann with separate normals (scene/brdf.py) on image-space maps.

    Sampling picks one of two techniques evenly: a cosine about the diffuse normal, or the visible
    Beckmann normals about the specular one; only the former where that normal turns away.
    """

    def __init__(self, props: Any) -> None:
        super().__init__(props)
        self.camera: Camera | None = None
        self.textures: dict[str, Any] = {}
        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
        diffuse = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
        self.m_components = [diffuse, flags]
        self.m_flags = diffuse | flags

    def set_maps(self, camera: Camera, maps: Maps) -> None:
        """Use `maps` (H, W), seen through `camera` of the same size."""
        self.camera = camera
        for name, image in {
            "diffuse_albedo": maps.diffuse_albedo,
            "specular_albedo": maps.specular_albedo[..., None],
            "roughness": maps.roughness[..., None],
            "specular_perturbation": maps.perturbation,
            "diffuse_perturbation": maps.diffuse_perturbation(),
        }.items():
            self.textures[name] = mi.Texture2f(
                mi.TensorXf(np.ascontiguousarray(image, dtype=np.float32)),
                filter_mode=dr.FilterMode.Linear,
                wrap_mode=dr.WrapMode.Clamp,
            )

    def _surface(self, si: Any, active: Any) -> tuple[Any, ...]:
        """Diffuse albedo, specular albedo, roughness and both unit normals (world) at `si`."""
        camera = self.camera
        assert camera is not None
        scale = camera.focal / -si.p.z
        uv = mi.Point2f(
            (camera.cx + si.p.x * scale) / camera.width,
            (camera.cy - si.p.y * scale) / camera.height,
        )
        look = {k: t.eval(uv, active) for k, t in self.textures.items()}
        n = mi.Vector3f(si.sh_frame.n)
        return (
            mi.Color3f(look["diffuse_albedo"]),
            look["specular_albedo"][0],
            look["roughness"][0],
            dr.normalize(n + mi.Vector3f(look["diffuse_perturbation"])),
            dr.normalize(n + mi.Vector3f(look["specular_perturbation"])),
        )

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval_pdf(ctx, si, wo, active)[1]

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        rho_d, rho_s, alpha, n_d, n_s = self._surface(si, active)
        viewer, towards = si.to_world(si.wi), si.to_world(wo)
        active = mi.Bool(active) & (si.wi.z > 0) & (wo.z > -0.3)
        value = rho_d * (at_least(dr.dot(n_d, towards), 0) / dr.pi)
        value += rho_s * specular(n_s, towards, viewer, alpha)
        return value & active, dr.select(active, self._pdf(n_d, n_s, alpha, viewer, towards), 0)

    def _pdf(self, n_d: Any, n_s: Any, alpha: Any, viewer: Any, towards: Any) -> Any:
        frame = mi.Frame3f(n_s)
        half = dr.normalize(viewer + towards)
        facets = mi.MicrofacetDistribution(mi.MicrofacetType.Beckmann, alpha, True)
        local = frame.to_local(viewer)
        lobe = facets.pdf(local, frame.to_local(half)) / (4 * at_least(dr.dot(towards, half), 1e-6))
        lobe = dr.select(dr.dot(towards, half) > 0, lobe, 0)
        cosine = at_least(dr.dot(n_d, towards), 0) / dr.pi
        return dr.select(local.z > 0, 0.5 * cosine + 0.5 * lobe, cosine)

    def sample(
        self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
    ) -> tuple[Any, Any]:
        _, _, alpha, n_d, n_s = self._surface(si, active)
        viewer = si.to_world(si.wi)
        cosine = mi.Frame3f(n_d).to_world(mi.warp.square_to_cosine_hemisphere(sample2))
        frame = mi.Frame3f(n_s)
        facets = mi.MicrofacetDistribution(mi.MicrofacetType.Beckmann, alpha, True)
        local = frame.to_local(viewer)
        half = facets.sample(local, sample2)[0]
        reflected = frame.to_world(mi.reflect(local, half))
        towards = dr.select((sample1 < 0.5) | (local.z <= 0), cosine, reflected)
        bs = dr.zeros(mi.BSDFSample3f, dr.width(si.p))
        bs.wo = si.to_local(towards)
        value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
        bs.eta = 1.0
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        bs.sampled_component = mi.UInt32(1)
        active = mi.Bool(active) & (bs.pdf > 0)
        return bs, (value / at_least(bs.pdf, 1e-20)) & active

    def to_string(self) -> str:
        return f"FaceBSDF[{', '.join(self.textures)}]"


mi.register_bsdf(PLUGIN, FaceBSDF)


def mitsuba_environment(environment: np.ndarray) -> Any:
    """mi.Bitmap of a latitude-longitude map (H, W[, 3]) for Mitsuba's `envmap` emitter.

    Mitsuba interpolates linearly between rows that span the poles (row i of H' at theta =
    pi i / (H' - 1)), while the project's maps hold the mean of each pixel. The map is therefore
    repeated four times along both axes, its edges falling halfway between two samples.
    """
    rgb = environment if environment.ndim == 3 else np.repeat(environment[..., None], 3, axis=2)
    rows = np.arange(4 * len(rgb) + 1)
    above = rgb[np.maximum(rows - 1, 0) // 4]
    below = rgb[np.minimum(rows, 4 * len(rgb) - 1) // 4]
    fine = np.repeat(0.5 * (above + below), 4, axis=1)
    return mi.Bitmap(np.ascontiguousarray(fine, dtype=np.float32))


def path_trace(
    mesh: Mesh,
    camera: Camera,
    maps: Maps,
    environment: np.ndarray,
    samples: int = 256,
    bounces: int = 1,
    seed: int = 0,
    progress: PassProgress = silent,
) -> np.ndarray:
    """Render the face by path tracing; returns (height, width, 3) float32 linear radiance.

    environment: (H, W) or (H, W, 3) radiance (scene/light.py). bounces: inter-reflections between
    parts of the face, 0 for direct light only. Pixels that see no face are 0.
    """
    body = face_body(mesh, camera, maps)
    return trace({"face": body}, camera, environment, samples, bounces, seed, progress)


def face_body(mesh: Mesh, camera: Camera, maps: Maps) -> Any:
    """The face as a mi.Mesh with the reflectance of `maps`, seen through `camera`."""
    face = mi.load_dict({"type": PLUGIN})
    face.set_maps(camera, maps)
    return mesh_body("face", face, mesh.vertices, mesh.normals, mesh.triangles)


def trace(
    objects: dict[str, Any],
    camera: Camera,
    environment: np.ndarray,
    samples: int,
    bounces: int,
    seed: int,
    progress: PassProgress = silent,
) -> np.ndarray:
    """Render `objects` (of a Mitsuba scene dictionary) as `path_trace` does the face."""
    light = {"type": "envmap", "bitmap": mitsuba_environment(environment)}
    scene = mi.load_dict({"type": "scene", "light": light, **objects})
    integrator = mi.load_dict(
        {"type": "path", "max_depth": bounces + 2, "hide_emitters": True, "rr_depth": 1000}
    )
    total = np.zeros((camera.height, camera.width, 3))
    # Passes bound the wavefront's memory and let a progress display breathe.
    passes = max(1, samples * camera.width * camera.height // 2**23)
    for k in range(passes):
        progress(k, passes)
        view = camera.mitsuba_sensor(-(-samples // passes))
        # A quarter of the variance of independent samples under an even light.
        view["sampler"]["type"] = "multijitter"
        image = mi.render(
            scene, sensor=mi.load_dict(view), integrator=integrator, seed=seed * 1000 + k
        )
        total += image.numpy()[..., :3]
    return (total / passes).astype(np.float32)


def mesh_body(
    name: str, bsdf: Any, vertices: Any, normals: Any, triangles: Any, uv: Any = None
) -> Any:
    """mi.Mesh with a BSDF, for a scene dictionary.

    vertices, normals: mi.Point3f and mi.Vector3f of the same width, world frame. triangles:
    mi.Vector3u. uv: mi.Point2f, one per vertex, or None.
    """
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    body = mi.Mesh(name, dr.width(vertices), dr.width(triangles), properties, True, uv is not None)
    parameters = mi.traverse(body)
    parameters["faces"] = dr.ravel(triangles)
    parameters["vertex_positions"] = dr.ravel(vertices)
    parameters["vertex_normals"] = dr.ravel(normals)
    if uv is not None:
        parameters["vertex_texcoords"] = dr.ravel(uv)
    parameters.update()
    return body
