"""Mesh files: Wavefront OBJ and binary PLY, with normals and texture coordinates.

Both are in the world frame of scene/camera.py (right-handed, y up, the camera at the origin
looking along -z), centimetres; texture coordinates have v up.
"""

from __future__ import annotations

import numpy as np

from ..reconstruction import Reconstruction

_PLY_PROPERTIES = ("x", "y", "z", "nx", "ny", "nz", "s", "t")


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit vertex normals (V, 3) float32: area-weighted, as the renderer shades (scene/mesh.py).

    In NumPy and float64, so that the same mesh gives the same file on every machine.
    """
    a, b, c = (vertices[triangles[:, i]].astype(np.float64) for i in range(3))
    face = np.cross(b - a, c - a)
    total = np.stack(
        [
            np.bincount(triangles.ravel(), np.repeat(face[:, axis], 3), len(vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return (total / np.maximum(length, 1e-30)).astype(np.float32)


def obj(reconstruction: Reconstruction) -> bytes:
    """Wavefront OBJ; positions, texture coordinates and normals are indexed separately."""
    r = reconstruction
    lines = ["# unlit: world frame = camera frame, y up, centimetres", "o face"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in r.vertices.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in r.uv.tolist()]
    normal = vertex_normals(r.vertices, r.triangles)
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in normal.tolist()]
    corners = np.stack([r.triangles, r.triangle_uv], axis=2) + 1
    lines += [
        f"f {a}/{ta}/{a} {b}/{tb}/{b} {c}/{tc}/{c}"
        for (a, ta), (b, tb), (c, tc) in corners.tolist()
    ]
    return ("\n".join(lines) + "\n").encode()


def ply(reconstruction: Reconstruction) -> bytes:
    """Binary little-endian PLY. A vertex on a seam is written once for each texture coordinate."""
    r = reconstruction
    pairs = np.stack([r.triangles.ravel(), r.triangle_uv.ravel()], axis=1)
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    normal = vertex_normals(r.vertices, r.triangles)
    vertex = np.concatenate(
        [r.vertices[unique[:, 0]], normal[unique[:, 0]], r.uv[unique[:, 1]]], axis=1
    ).astype("<f4")
    face = np.empty(len(r.triangles), dtype=[("count", "u1"), ("vertex", "<i4", 3)])
    face["count"] = 3
    face["vertex"] = index.reshape(-1, 3)
    properties = "".join(f"property float {name}\n" for name in _PLY_PROPERTIES)
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment unlit: world frame = camera frame, y up, centimetres\n"
        f"element vertex {len(vertex)}\n{properties}"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode() + vertex.tobytes() + face.tobytes()
