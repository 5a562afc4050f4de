"""face.glb: the face as binary glTF 2.0, with all its textures inside.

Metres, y up, the face towards +z, the origin in the middle of the head. A camera node stands
where the photo's camera stood; its field is widened about the optical axis until it holds the
crop, whose window is in the camera's extras.

glTF has one specular lobe (GGX, where ours is Beckmann) and one normal for both lobes (we give it
the specular one). Of the same roughness alpha both distributions have the same peak, so that
roughness = sqrt(alpha). The specular albedo is KHR_materials_specular's factor up to 1, which
scales the whole lobe as ours does; above 1 it is its colour, which scales all but the grazing
reflection. The index of refraction is KHR_materials_ior's.
"""

from __future__ import annotations

import json
import struct
from importlib.metadata import version
from typing import Any

import numpy as np

from ..color import encode_srgb
from ..face.reconstruction import Reconstruction
from ..scene.brdf import IOR
from .atlas import Atlas
from .images import bytes_of, encoded, png
from .parts import PARTS
from .textures import normal_bytes, perceptual_roughness

#: Metres in a centimetre.
METRE = 0.01

_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963  # targets of buffer views
_LINEAR, _MIPMAPS, _CLAMP = 9729, 9987, 33071


def glb(reconstruction: Reconstruction, atlas: Atlas) -> bytes:
    """A binary glTF file of the face with the maps of `atlas`."""
    mesh = atlas.mesh
    centre = (mesh.position.min(axis=0) + mesh.position.max(axis=0)) / 2
    file = _File()
    attributes = {
        "POSITION": file.vertices((mesh.position - centre) * METRE, bounds=True),
        "NORMAL": file.vertices(mesh.normal),
        "TANGENT": file.vertices(mesh.tangent),
        "TEXCOORD_0": file.vertices(np.stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]], axis=1)),
    }
    present = [index for index in range(len(PARTS)) if (atlas.part == index).any()]
    primitives = [
        {
            "attributes": attributes,
            "indices": file.indices(mesh.triangles[atlas.part == index]),
            "material": number,
        }
        for number, index in enumerate(present)
    ]
    material = _material(file, atlas)
    document = {
        "asset": {"version": "2.0", "generator": f"unlit {version('unlit')}"},
        "extensionsUsed": ["KHR_materials_ior", "KHR_materials_specular"],
        "scene": 0,
        "scenes": [{"name": reconstruction.photo.name or "face", "nodes": [0, 1]}],
        "nodes": [
            {"name": "face", "mesh": 0},
            {"name": "photo camera", "camera": 0, "translation": (-centre * METRE).tolist()},
        ],
        "meshes": [{"name": "face", "primitives": primitives}],
        "cameras": [_camera(reconstruction)],
        "materials": [{"name": PARTS[index], **material} for index in present],
        **file.tables(),
    }
    return file.packed(document)


def specular_texture(albedo: np.ndarray) -> tuple[np.ndarray, float]:
    """(N, N, 4) uint8 texture of KHR_materials_specular, and the factor of its colour.

    albedo: (N, N) specular albedo. Alpha, linear, holds what is up to 1; the colour,
    sRGB-encoded, what is above, over the factor.
    """
    above = np.maximum(albedo, 1)
    factor = float(above.max())
    colour = np.repeat(encode_srgb(above / factor)[..., None], 3, axis=-1)
    return bytes_of(np.concatenate([colour, albedo[..., None]], axis=-1)), factor


def _material(file: _File, atlas: Atlas) -> dict[str, Any]:
    rough = perceptual_roughness(atlas.roughness)
    # Red is for occlusion, which is not used; blue is the metalness.
    surface = np.stack([np.full_like(rough, 255), rough, np.zeros_like(rough)], axis=-1)
    specular, factor = specular_texture(atlas.specular_albedo)
    specular_index = {"index": file.texture("specular", specular)}
    return {
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": file.texture("albedo", encoded(atlas.diffuse_albedo))},
            "metallicRoughnessTexture": {"index": file.texture("roughness", surface)},
            "metallicFactor": 0,
        },
        "normalTexture": {"index": file.texture("normal", normal_bytes(atlas.specular_normal))},
        "extensions": {
            "KHR_materials_ior": {"ior": IOR},
            "KHR_materials_specular": {
                "specularTexture": specular_index,
                "specularColorTexture": specular_index,
                "specularColorFactor": [factor] * 3,
            },
        },
    }


def _camera(r: Reconstruction) -> dict[str, Any]:
    camera = r.face.camera
    half_x = max(camera.cx, camera.width - camera.cx)
    half_y = max(camera.cy, camera.height - camera.cy)
    return {
        "name": "photo camera",
        "type": "perspective",
        "perspective": {
            "yfov": float(2 * np.arctan(half_y / camera.focal)),
            "aspectRatio": float(half_x / half_y),
            "znear": 0.01,
        },
        "extras": {
            "film": [2 * half_x, 2 * half_y],
            "crop": [half_x - camera.cx, half_y - camera.cy, camera.width, camera.height],
        },
    }


class _File:
    """Collects the binary part, and the tables that say what is where in it."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._images: list[dict[str, Any]] = []

    def vertices(self, values: np.ndarray, bounds: bool = False) -> int:
        """Accessor of (V, C) float32."""
        values = np.ascontiguousarray(values, dtype="<f4")
        limits = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self._accessor(
            values.tobytes(),
            _VERTICES,
            {
                "componentType": _FLOAT,
                "count": len(values),
                "type": f"VEC{values.shape[1]}",
                **(limits if bounds else {}),
            },
        )

    def indices(self, triangles: np.ndarray) -> int:
        """Accessor of (F, 3) indices."""
        return self._accessor(
            np.ascontiguousarray(triangles, dtype="<u4").tobytes(),
            _INDICES,
            {"componentType": _UINT, "count": triangles.size, "type": "SCALAR"},
        )

    def texture(self, name: str, pixels: np.ndarray) -> int:
        """Texture of (N, N, C) uint8."""
        view = self._view(png(pixels))
        self._images.append({"name": name, "mimeType": "image/png", "bufferView": view})
        return len(self._images) - 1

    def tables(self) -> dict[str, Any]:
        return {
            "images": self._images,
            "samplers": [
                {"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _CLAMP, "wrapT": _CLAMP}
            ],
            "textures": [{"sampler": 0, "source": index} for index in range(len(self._images))],
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._binary)}],
        }

    def packed(self, document: dict[str, Any]) -> bytes:
        """The GLB container: header, JSON chunk, binary chunk, each a multiple of four bytes."""
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = b"".join(
            struct.pack("<I4s", len(data), kind) + data
            for kind, data in ((b"JSON", text), (b"BIN\0", bytes(self._binary)))
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _accessor(self, data: bytes, target: int, accessor: dict[str, Any]) -> int:
        self._accessors.append({"bufferView": self._view(data, target), **accessor})
        return len(self._accessors) - 1

    def _view(self, data: bytes, target: int | None = None) -> int:
        place = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._views.append(place | ({"target": target} if target else {}))
        self._binary += data + b"\0" * (-len(data) % 4)
        return len(self._views) - 1
