"""Mesh files: Wavefront OBJ with MTL and binary PLY, with normals and texture coordinates.

Both are in the world frame of scene/camera.py (right-handed, y up, the camera at the origin
looking along -z), centimetres; texture coordinates have v up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..face.reconstruction import Reconstruction
from ..scene.normals import vertex_normals
from . import textures
from .parts import PARTS
from .tangent import tangents

_PLY_PROPERTIES = ("x", "y", "z", "nx", "ny", "nz", "s", "t")


@dataclass(frozen=True)
class Welded:
    """The mesh with one index per corner: a vertex on a seam once for each texture coordinate.

    vertex: (W,) row of the reconstruction's vertices. position: (W, 3) cm, world frame. normal:
    (W, 3) unit. uv: (W, 2), v up. tangent: (W, 4), see tangent.py. All float32. triangles: (F, 3)
    int32, in the order of the reconstruction's.
    """

    vertex: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    tangent: np.ndarray
    triangles: np.ndarray


def welded(reconstruction: Reconstruction) -> Welded:
    """The mesh of `reconstruction` as renderers and file formats with one index want it."""
    r = reconstruction
    pairs = np.stack([r.face.mesh.triangles.ravel(), r.face.mesh.triangle_uv.ravel()], axis=1)
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int32)
    vertex = unique[:, 0]
    position, uv = r.face.mesh.vertices[vertex], r.face.mesh.uv[unique[:, 1]]
    normal = vertex_normals(r.face.mesh.vertices, r.face.mesh.triangles)[vertex].astype(np.float32)
    return Welded(
        vertex, position, normal, uv, tangents(position, normal, uv, triangles), triangles
    )


def obj(reconstruction: Reconstruction, part: np.ndarray, materials: str) -> bytes:
    """Wavefront OBJ; positions, texture coordinates and normals are indexed separately.

    part: (F,) index into PARTS of each triangle: faces are grouped by it, one material each.
    materials: name of the MTL file.
    """
    r = reconstruction
    lines = [
        "# unlit: world frame = camera frame, y up, centimetres",
        f"mtllib {materials}",
        "o face",
    ]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in r.face.mesh.vertices.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in r.face.mesh.uv.tolist()]
    normal = vertex_normals(r.face.mesh.vertices, r.face.mesh.triangles)
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in normal.tolist()]
    corners = np.stack([r.face.mesh.triangles, r.face.mesh.triangle_uv], axis=2) + 1
    for index, name in enumerate(PARTS):
        faces = corners[part == index].tolist()
        lines += [f"usemtl {name}"] * bool(faces)
        lines += [
            f"f {a}/{ta}/{a} {b}/{tb}/{b} {c}/{tc}/{c}" for (a, ta), (b, tb), (c, tc) in faces
        ]
    return ("\n".join(lines) + "\n").encode()


def mtl(part: np.ndarray) -> bytes:
    """The materials of `obj`, with the textures of textures.py beside it.

    The last three lines of each are the physically based extension that Blender and others read.
    """
    from ..scene.brdf import IOR

    lines = ["# unlit"]
    for index in np.unique(part):
        lines += [
            f"newmtl {PARTS[index]}",
            "Kd 1 1 1",
            "Ks 0.0255 0.0255 0.0255",
            "Ns 20",
            f"Ni {IOR}",
            "illum 2",
            f"map_Kd {textures.ALBEDO}",
            f"map_Pr {textures.ROUGHNESS}",
            "Pm 0",
            f"norm {textures.NORMAL}",
        ]
    return ("\n".join(lines) + "\n").encode()


def ply(reconstruction: Reconstruction) -> bytes:
    """Binary little-endian PLY. A vertex on a seam is written once for each texture coordinate."""
    mesh = welded(reconstruction)
    vertex = np.concatenate([mesh.position, mesh.normal, mesh.uv], axis=1).astype("<f4")
    face = np.empty(len(mesh.triangles), dtype=[("count", "u1"), ("vertex", "<i4", 3)])
    face["count"] = 3
    face["vertex"] = mesh.triangles
    properties = "".join(f"property float {name}\n" for name in _PLY_PROPERTIES)
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment unlit: world frame = camera frame, y up, centimetres\n"
        f"comment TextureFile {textures.ALBEDO}\n"
        f"element vertex {len(vertex)}\n{properties}"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode() + vertex.tobytes() + face.tobytes()
