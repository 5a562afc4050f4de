"""What the report's viewer draws: geometry, self-shadowing and lights, packed for the browser.

The viewer (viewer/src) shades with our reflectance model and textures of the atlas. What a shader
cannot find out by itself is baked here: for every vertex, which of 648 directions of light it
sees. Approximations, all of them the viewer's: the light is merged into 32 spherical Gaussians;
shadows are as coarse as the directions (10 degrees) and the vertices, and the same for both
lobes; inter-reflection is guessed from how much of the sky the head hides. Eyeballs have a clear
cornea (output/cornea.py) as a second lobe.
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba
from ..output.atlas import Atlas
from ..output.cornea import surface_over
from ..output.eyes import eyes_of
from ..output.geometry import Welded
from ..output.images import bytes_of
from ..output.relit import outdoors
from ..render.visibility import trace, unpacked
from ..scene.arrays import device
from ..scene.cells import grid_cells
from ..scene.light import coloured, flash, uniform
from ..scene.mesh import Mesh

mi = mitsuba()

#: Rows and columns of the lights, and of the directions of visibility.
_LIGHT = (36, 72)
_CELLS = (18, 36)


@dataclass(frozen=True)
class Scene:
    """numbers: JSON. arrays: base64 of a zlib stream of the arrays that `numbers` lists."""

    numbers: str
    arrays: str


def scene(r: Reconstruction, atlas: Atlas) -> Scene:
    """Mesh, visibility, camera and lights for the viewer, in the world frame, cm."""
    mesh = atlas.mesh
    low = mesh.position.min(axis=0)
    extent = np.ptp(mesh.position, axis=0)
    small = len(mesh.position) <= 1 << 16
    arrays = {
        "position": _fixed((mesh.position - low) / extent, np.uint16),
        "normal": _fixed(mesh.normal, np.int16),
        "tangent": _fixed(mesh.tangent, np.int16),
        "uv": _fixed(mesh.uv, np.uint16),
        "triangles": mesh.triangles.astype(np.uint16 if small else np.uint32),
    }
    arrays["clear"] = _fixed(_clear(r, mesh), np.int16)
    seen = _seen(r, mesh.position, mesh.normal)
    arrays["visibility"] = _bitsets(seen)
    arrays["hidden"] = _fixed(_hidden(seen, mesh.normal), np.uint8)
    lights = {}
    for name, environment in {
        "photo": r.light.environment,
        "flash": flash(),
        "uniform": uniform(),
        "sky": outdoors(),
    }.items():
        radiance = grid_cells(*_LIGHT).average(coloured(environment))
        arrays[f"light {name}"] = radiance.astype(np.float32)
        lights[name] = {"rows": _LIGHT[0], "columns": _LIGHT[1], "radiance": f"light {name}"}
    camera = r.face.camera
    numbers, packed = _packed(arrays)
    numbers |= {
        "low": low.tolist(),
        "extent": extent.tolist(),
        "middle": (low + extent / 2).tolist(),
        "camera": {"size": camera.width, "focal": camera.focal, "cx": camera.cx, "cy": camera.cy},
        "lights": lights,
    }
    return Scene(json.dumps(numbers), packed)


def material(atlas: Atlas) -> np.ndarray:
    """(N, N, 3) uint8: specular albedo, 0 to 2; square root of alpha, 0 to 1; confidence."""
    channels = [atlas.specular_albedo / 2, np.sqrt(atlas.roughness), atlas.confidence / 255]
    return bytes_of(np.dstack(channels))


def _clear(r: Reconstruction, mesh: Welded) -> np.ndarray:
    """(W, 3) normals of the corneas before the eyeballs' corners; 0 elsewhere."""
    out = np.zeros(mesh.position.shape)
    for eye in eyes_of(r):
        ball = eye.vertices[mesh.vertex]
        direction = (mesh.position[ball] - eye.centre) / eye.radius
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        out[ball] = surface_over(eye, direction)[1]
    return out


def _seen(r: Reconstruction, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(D, V) uint8: 1 where the vertex sees the direction."""
    directions = device(mi.Vector3f, grid_cells(*_CELLS).direction)
    point, up = device(mi.Point3f, position), device(mi.Vector3f, normal)
    bits = trace(Mesh(r.face.mesh.vertices, r.face.mesh.triangles).scene, point, up, up, directions)
    return unpacked(bits, len(position), dr.width(directions))


def _bitsets(seen: np.ndarray) -> np.ndarray:
    """(D, W) uint32: bit v % 32 of word v // 32 is `seen` (D, V)."""
    padded = np.pad(seen, ((0, 0), (0, -seen.shape[1] % 32)))
    packed = np.packbits(padded, axis=1, bitorder="little")
    return np.ascontiguousarray(packed).view(np.uint32)


def _hidden(seen: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(V,) share of an even light, cosine-weighted, that the head keeps from each vertex."""
    moment = grid_cells(*_CELLS).moment.astype(np.float32) / np.float32(np.pi)
    cosine = np.maximum(moment @ normal.T, 0)
    return 1 - (cosine * seen).sum(axis=0) / cosine.sum(axis=0)


def _fixed(values: np.ndarray, kind: type[np.integer[Any]]) -> np.ndarray:
    """Values in [0, 1], or [-1, 1] for a signed type, as a fraction of the type's maximum."""
    most = np.iinfo(kind).max
    least = 0 if np.iinfo(kind).min == 0 else -most
    return np.rint(np.clip(values * most, least, most)).astype(kind)


def _packed(arrays: dict[str, np.ndarray]) -> tuple[dict[str, Any], str]:
    table, binary = {}, bytearray()
    for name, array in arrays.items():
        data = array.astype(array.dtype.newbyteorder("<")).tobytes()
        kind = f"{array.dtype.kind}{array.dtype.itemsize}"
        table[name] = {"kind": kind, "offset": len(binary), "length": array.size}
        binary += data + b"\0" * (-len(data) % 4)
    return {"arrays": table}, base64.b64encode(zlib.compress(bytes(binary), 9)).decode()
