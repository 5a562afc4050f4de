"""A scanned head as a subject: meshes with measured maps, and the camera that looks at it.

The maps live on the meshes' own texture coordinates, unlike those of a reconstruction, and the
normal map bends both lobes. Everything is moved into the camera's frame (scene/camera.py), cm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np

from ..color import encode_srgb
from ..errors import SubjectError
from ..machine.runtime import mitsuba
from ..perception.landmarks import find_faces
from ..photo.crop import face_crop
from ..render.reference import FaceBSDF, mesh_body, trace
from ..scene.arrays import at_least, device
from ..scene.camera import Camera
from ..scene.light import uniform
from ..scene.mesh import camera_rays
from .truth import Truth

mi = mitsuba()

PLUGIN = "unlit_scan"
BOUNCES = 3
#: How a subject without a camera is seen: from this distance, cm, as the crop of a photo would.
FRONTAL_DISTANCE = 100.0
_FIRST_FIELD = 60.0
_FIRST_FILM = 256
_FINE = 4


@dataclass(frozen=True)
class Part:
    """One mesh of a scan in the world frame, cm. v = 0 is the bottom row of every map.

    vertices, normals: (V, 3); triangles: (F, 3) into both; uv: (V, 2).
    diffuse: (h, w, 3) linear sRGB. specular, roughness: (h, w, 1). normal: (h, w, 3) vectors, not
    necessarily unit; in the tangent frame (u, v, out), or where `object_space` in the world's.
    """

    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    diffuse: np.ndarray
    specular: np.ndarray
    roughness: np.ndarray
    normal: np.ndarray
    object_space: bool = False

    def moved(self, rotation: np.ndarray, shift: np.ndarray) -> Part:
        """The part in another frame: x -> rotation x + shift."""
        normal = self.normal @ rotation.T if self.object_space else self.normal
        return replace(
            self,
            vertices=self.vertices @ rotation.T + shift,
            normals=self.normals @ rotation.T,
            normal=normal,
        )


class ScanBSDF(FaceBSDF):
    """The reflectance of reference.py on maps in texture coordinates."""

    object_space = False

    def set_part(self, part: Part) -> None:
        self.object_space = part.object_space
        for name in ("diffuse", "specular", "roughness", "normal"):
            image = np.ascontiguousarray(getattr(part, name)[::-1], dtype=np.float32)
            self.textures[name] = mi.Texture2f(
                mi.TensorXf(image), filter_mode=dr.FilterMode.Linear, wrap_mode=dr.WrapMode.Repeat
            )

    def _surface(self, si: Any, active: Any) -> tuple[Any, ...]:
        look = {name: t.eval(si.uv, active) for name, t in self.textures.items()}
        bent = mi.Vector3f(look["normal"])
        n = mi.Vector3f(si.sh_frame.n)
        if not self.object_space:
            tangent = si.dp_du - n * dr.dot(n, si.dp_du)
            tangent *= dr.rsqrt(at_least(dr.squared_norm(tangent), 1e-20))
            across = dr.cross(n, tangent)
            across = dr.select(dr.dot(across, si.dp_dv) < 0, -across, across)
            bent = tangent * bent.x + across * bent.y + n * bent.z
        bent *= dr.rsqrt(at_least(dr.squared_norm(bent), 1e-20))
        return (
            mi.Color3f(look["diffuse"]),
            look["specular"][0],
            look["roughness"][0],
            bent,
            bent,
        )


mi.register_bsdf(PLUGIN, ScanBSDF)


@dataclass(frozen=True)
class Scan:
    """A scan before its camera, in the camera's frame; one whole subject of an evaluation."""

    name: str
    camera: Camera
    parts: tuple[Part, ...]

    def photograph(self, environment: np.ndarray, samples: int = 256, seed: int = 0) -> np.ndarray:
        """Path-traced image (H, W, 3), linear, with three inter-reflections."""
        return trace(self.bodies, self.camera, environment, samples, BOUNCES, seed)

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) and triangles (F, 3) of all parts together."""
        starts = np.cumsum([0, *(len(part.vertices) for part in self.parts)])
        pairs = zip(self.parts, starts, strict=False)
        triangles = np.concatenate([part.triangles + start for part, start in pairs])
        return np.concatenate([part.vertices for part in self.parts]), triangles

    @cached_property
    def truth(self) -> Truth:
        """What the camera sees, by 4 x 4 rays a pixel."""
        fine = _scaled(self.camera, _FINE * self.camera.width)
        scene = mi.load_dict({"type": "scene", **self.bodies})
        rays = camera_rays(fine, dr.arange(mi.UInt32, fine.width * fine.height))
        si = scene.ray_intersect(rays)
        seen = si.is_valid()
        out = np.zeros((fine.width * fine.height, 10), dtype=np.float32)
        for index, body in enumerate(self.bodies.values()):
            here = seen & (si.shape == mi.ShapePtr(body))
            bsdf = self._materials[index]
            diffuse, specular, _, normal, _ = bsdf._surface(si, here)
            rows = here.numpy()
            diffuse, normal, place = (values.numpy().T for values in (diffuse, normal, si.p))
            out[rows] = np.column_stack([diffuse, specular.numpy(), normal, place])[rows]
        share = seen.numpy().astype(np.float32)[:, None]
        sums = _blocks(np.concatenate([out, share], axis=1), fine.width)
        known = sums[..., -1:] > 0
        means = np.where(known, sums / np.maximum(sums[..., -1:], 1e-6), 0)
        length = np.linalg.norm(means[..., 4:7], axis=-1, keepdims=True)
        return Truth(
            diffuse_albedo=means[..., 0:3],
            specular_albedo=means[..., 3],
            normal=means[..., 4:7] / np.maximum(length, 1e-6),
            position=means[..., 7:10],
            seen=sums[..., -1] >= _FINE**2,
        )

    @cached_property
    def _materials(self) -> list[Any]:
        materials = []
        for part in self.parts:
            material = mi.load_dict({"type": PLUGIN})
            material.set_part(part)
            materials.append(material)
        return materials

    @cached_property
    def bodies(self) -> dict[str, Any]:
        """The parts as objects of a Mitsuba scene, by name."""
        return {
            f"part{k}": _body(f"part{k}", part, material)
            for k, (part, material) in enumerate(zip(self.parts, self._materials, strict=True))
        }


def _body(name: str, part: Part, material: Any) -> Any:
    return mesh_body(
        name,
        material,
        device(mi.Point3f, part.vertices),
        device(mi.Vector3f, part.normals),
        device(mi.Vector3u, part.triangles),
        device(mi.Point2f, part.uv),
    )


def _blocks(values: np.ndarray, width: int) -> np.ndarray:
    """Sums over the blocks of fine pixels: (H W, C) at the fine size to (h, w, C)."""
    side = width // _FINE
    blocks = values.reshape(side, _FINE, side, _FINE, -1)
    return blocks.sum(axis=(1, 3), dtype=np.float64).astype(np.float32)


def _scaled(camera: Camera, size: int) -> Camera:
    """The same view on a square film of `size` pixels."""
    scale = size / camera.width
    return Camera(size, size, camera.focal * scale, camera.cx * scale, camera.cy * scale)


def seen_by(
    name: str, parts: tuple[Part, ...], camera: Camera, camera_to_world: np.ndarray, size: int
) -> Scan:
    """`parts` before a camera whose pose (4, 4) takes its frame to the world's, cm."""
    rotation = camera_to_world[:3, :3].T
    shift = -rotation @ camera_to_world[:3, 3]
    return Scan(name, _scaled(camera, size), tuple(p.moved(rotation, shift) for p in parts))


def frontal(name: str, parts: tuple[Part, ...], size: int) -> Scan:
    """`parts` as a portrait's crop shows them: the face, found in a first render, fills it.

    The face looks along +z, y up. Raises SubjectError where no face is found.
    """
    low = np.min([p.vertices.min(axis=0) for p in parts], axis=0)
    high = np.max([p.vertices.max(axis=0) for p in parts], axis=0)
    pose = np.eye(4)
    pose[:3, 3] = (*((low + high) / 2)[:2], high[2] + FRONTAL_DISTANCE)
    # One size for every film, so that the framing does not depend on it.
    film = _FIRST_FILM
    focal = film * FRONTAL_DISTANCE / max(_FIRST_FIELD, 1.2 * (high - low)[:2].max())
    camera = Camera(film, film, focal, film / 2, film / 2)
    for _ in range(3):
        scan = seen_by(name, parts, camera, pose, film)
        picture = scan.photograph(uniform(), samples=16)
        bright = picture * (0.7 / max(float(np.percentile(picture, 99)), 1e-6))
        encoded = np.rint(255 * np.clip(encode_srgb(bright), 0, 1)).astype(np.uint8)
        faces = find_faces(encoded)
        if not faces:
            raise SubjectError(
                f"{name}: no face found from the front; check object_to_world (the face must look "
                "along +z, y up), units, and the v axis of the maps, or give a camera"
            )
        crop = face_crop(faces[0].landmarks, film, (film, film))
        centre = crop.inverse_points(np.array([film / 2, film / 2]))
        distance = -float(scan.truth.position[scan.truth.seen][:, 2].max())
        aside = (centre - film / 2) * (1, -1) * distance / camera.focal
        pose[:3, 3] += (*aside, FRONTAL_DISTANCE - distance)
        camera = replace(camera, focal=camera.focal * crop.scale * FRONTAL_DISTANCE / distance)
    return seen_by(name, parts, camera, pose, size)
