"""Meshes and maps whose look is known by hand: a flat plate, 20 x 20, facing +z, uv v up."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image

VERTICES = np.array([[-10, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0]], dtype=float)
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])

OBJ = """\
# a plate
v -10 -10 0
v 10 -10 0
v 10 10 0
v -10 10 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
f 1/1 2/2 3/3 -1/-1
"""


def glb(uv: np.ndarray = UV, **document: object) -> bytes:
    """The plate as a GLB file, under a node that moves it by 1 along x."""
    parts = [
        TRIANGLES.astype("<u2").tobytes(),
        VERTICES.astype("<f4").tobytes(),
        uv.astype("<f4").tobytes(),
    ]
    starts = np.cumsum([0, *map(len, parts)])
    kinds = ((5123, "SCALAR", 6), (5126, "VEC3", 4), (5126, "VEC2", 4))
    content = {
        "asset": {"version": "2.0"},
        "nodes": [{"children": [1], "translation": [1, 0, 0]}, {"mesh": 0}],
        "meshes": [
            {"primitives": [{"indices": 0, "attributes": {"POSITION": 1, "TEXCOORD_0": 2}}]}
        ],
        "accessors": [
            {"bufferView": k, "componentType": kind, "type": shape, "count": count}
            for k, (kind, shape, count) in enumerate(kinds)
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(start), "byteLength": len(part)}
            for start, part in zip(starts, parts, strict=False)
        ],
        **document,
    }
    return glb_of(json.dumps(content).encode(), b"".join(parts))


def glb_of(text: bytes, body: bytes = b"") -> bytes:
    """A GLB file of this JSON and this buffer."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def ply(style: str) -> bytes:
    """The plate as a PLY file: ascii, binary_little_endian or binary_big_endian."""
    header = (
        f"ply\nformat {style} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nproperty float s\nproperty float t\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    rows = np.concatenate([VERTICES, UV], axis=1)
    if style == "ascii":
        lines = [" ".join(map(str, row)) for row in rows]
        return header + "\n".join([*lines, "4 0 1 2 3", ""]).encode()
    order = "<" if style == "binary_little_endian" else ">"
    return header + rows.astype(f"{order}f4").tobytes() + struct.pack(f"{order}B4i", 4, 0, 1, 2, 3)


def quarters(path: Path) -> np.ndarray:
    """Write a picture whose quarters differ; returns its linear colours, (2, 2, 3), top first."""
    colours = np.array([[[200, 40, 40], [40, 200, 40]], [[40, 40, 200], [200, 200, 40]]], np.uint8)
    Image.fromarray(colours.repeat(32, axis=0).repeat(32, axis=1)).save(path)
    encoded = colours / 255.0
    return np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)


MINIMAL = """\
format = 1
name = "plate"
units = "cm"
[camera]
width = 64
fov_x = 24.0
camera_to_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 50], [0, 0, 0, 1]]
[[mesh]]
file = "plate.obj"
diffuse_albedo = { file = "albedo.png", encoding = "srgb" }
"""


def folder(place: Path, text: str = MINIMAL) -> Path:
    """A folder with the plate as OBJ, its albedo, and `text` as subject.toml."""
    (place / "plate.obj").write_text(OBJ)
    quarters(place / "albedo.png")
    (place / "subject.toml").write_text(text)
    return place / "subject.toml"
