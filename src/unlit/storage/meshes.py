"""Read a triangle mesh with texture coordinates from an OBJ, PLY or GLB file.

Only what a scan needs: positions, one set of texture coordinates, polygons (cut into fans). The
files come from anywhere, so sizes and indices are checked before they are used.
"""

# pyright: basic
from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SubjectError

_MAX_BYTES = 1 << 30
_MAX_ELEMENTS = 20_000_000
#: What the readers run into when a file does not hold what its format says, or is nested without
#: end.
_BROKEN = (
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
    struct.error,
)


@dataclass(frozen=True)
class Surface:
    """vertices: (V, 3) float64; triangles: (F, 3) int64; in the file's own frame and unit.

    uv: (T, 2) float64 as the file has it, and triangle_uv: (F, 3) into it; or both None.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray | None = None
    triangle_uv: np.ndarray | None = None


#: Where v = 0 lies by each format's convention: "up" at the picture's bottom row.
V_AXIS = {".obj": "up", ".ply": "up", ".glb": "down"}


def read_mesh(path: Path) -> Surface:
    """The mesh in `path`. Raises SubjectError that names the file."""
    readers = {".obj": _obj, ".ply": _ply, ".glb": _glb}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise SubjectError(f"{path}: not a mesh; give an .obj, .ply or .glb file")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise SubjectError(f"{path}: larger than 1 GB; give a smaller mesh")
        surface = reader(path.read_bytes())
    except OSError as error:
        raise SubjectError(f"{path}: cannot be read ({error.strerror})") from error
    except _BROKEN as error:
        raise SubjectError(f"{path}: not a whole {path.suffix} mesh ({error})") from error
    return _checked(surface, path)


def _checked(surface: Surface, path: Path) -> Surface:
    if not len(surface.vertices) or not len(surface.triangles):
        raise SubjectError(f"{path}: holds no triangles")
    if not np.isfinite(surface.vertices).all():
        raise SubjectError(f"{path}: some vertices are not finite numbers")
    pairs = [(surface.triangles, surface.vertices)]
    if surface.uv is not None and surface.triangle_uv is not None:
        pairs.append((surface.triangle_uv, surface.uv))
        if not np.isfinite(surface.uv).all():
            raise SubjectError(f"{path}: some texture coordinates are not finite numbers")
    for index, table in pairs:
        if index.min() < 0 or index.max() >= len(table):
            raise SubjectError(f"{path}: a face names a vertex that is not there")
    return surface


def _fans(polygons: list[list[int]]) -> np.ndarray:
    return np.array(
        [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)], dtype=np.int64
    ).reshape(-1, 3)


def _obj(content: bytes) -> Surface:
    vertices: list[list[float]] = []
    uv: list[list[float]] = []
    corners: list[list[int]] = []
    corners_uv: list[list[int]] = []
    for line in content.decode("utf-8", errors="replace").splitlines():
        words = line.split()
        match words[:1]:
            case ["v"]:
                vertices.append([float(w) for w in words[1:4]])
            case ["vt"]:
                uv.append([float(w) for w in words[1:3]])
            case ["f"]:
                parts = [word.split("/") for word in words[1:]]
                corners.append([_obj_index(p[0], len(vertices)) for p in parts])
                if all(len(p) > 1 and p[1] for p in parts):
                    corners_uv.append([_obj_index(p[1], len(uv)) for p in parts])
    mapped = bool(uv) and len(corners_uv) == len(corners)
    return Surface(
        np.array(vertices, dtype=np.float64).reshape(-1, 3),
        _fans(corners),
        np.array(uv, dtype=np.float64).reshape(-1, 2) if mapped else None,
        _fans(corners_uv) if mapped else None,
    )


def _obj_index(word: str, count: int) -> int:
    """OBJ counts from 1, or backwards from the last so far; 0 is an error told later."""
    number = int(word)
    return number - 1 if number >= 0 else count + number


_PLY_NAMES = (
    "char uchar short ushort int uint float double",
    "int8 uint8 int16 uint16 int32 uint32 float32 float64",
)
_PLY_KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_PLY_TYPES = {
    name: kind for names in _PLY_NAMES for name, kind in zip(names.split(), _PLY_KINDS, strict=True)
}
_PLY_UV = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))


def _ply(content: bytes) -> Surface:
    header, _, body = content.partition(b"end_header")
    lines = header.decode("ascii", errors="replace").split("\n")
    if lines[0].strip() != "ply" or not body:
        raise ValueError("no header")
    body = body[body.index(b"\n") + 1 :]
    order = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
    style, elements = "", []
    for words in (line.split() for line in lines[1:]):
        match words:
            case ["format", name, _]:
                style = order[name]
            case ["element", name, count]:
                if not 0 <= int(count) <= _MAX_ELEMENTS:
                    raise ValueError(f"{count} elements")
                elements.append((name, int(count), []))
            case ["property", *rest]:
                elements[-1][2].append(rest)
    read = _ply_ascii if style == "" else _ply_binary
    tables = read(body, elements, style)
    vertex = tables["vertex"]
    vertices = np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    face = tables["face"]
    corners = face.get("vertex_indices", face.get("vertex_index"))
    if corners is None:
        raise ValueError("faces without vertex_indices")
    triangles = _fans(corners)
    for u, v in _PLY_UV:
        if u in vertex and v in vertex:
            uv = np.stack([np.asarray(vertex[u], float), np.asarray(vertex[v], float)], axis=1)
            return Surface(vertices, triangles, uv, triangles)
    return Surface(vertices, triangles)


Table = dict[str, Any]


def _ply_ascii(body: bytes, elements: list[Any], style: str) -> dict[str, Table]:
    lines = body.decode("ascii", errors="replace").split("\n")
    if sum(count for _, count, _ in elements) > len(lines):
        raise ValueError("cut off")
    rows = iter(lines)
    tables: dict[str, Table] = {}
    for name, count, properties in elements:
        table: Table = {p[-1]: [] for p in properties}
        for _ in range(count):
            words = iter(next(rows).split())
            for p in properties:
                if p[0] == "list":
                    size = int(next(words, "-1"))
                    value: Any = [int(next(words, "")) for _ in range(size)]
                else:
                    value = float(next(words, "nan"))
                table[p[-1]].append(value)
        tables[name] = table
    return tables


def _ply_binary(body: bytes, elements: list[Any], style: str) -> dict[str, Table]:
    tables: dict[str, Table] = {}
    offset = 0
    for name, count, properties in elements:
        if not any(p[0] == "list" for p in properties):
            kind = np.dtype([(p[-1], style + _PLY_TYPES[p[0]]) for p in properties])
            data = np.frombuffer(body, kind, count, offset)
            tables[name] = {n: data[n] for n in kind.names or ()}
            offset += kind.itemsize * count
            continue
        table = {p[-1]: [] for p in properties}
        for _ in range(count):
            for p in properties:
                if p[0] == "list":
                    size = int(np.frombuffer(body, style + _PLY_TYPES[p[1]], 1, offset)[0])
                    offset += np.dtype(_PLY_TYPES[p[1]]).itemsize
                    kind = np.dtype(style + _PLY_TYPES[p[2]])
                    value: Any = np.frombuffer(body, kind, size, offset).tolist()
                    offset += size * kind.itemsize
                else:
                    kind = np.dtype(style + _PLY_TYPES[p[0]])
                    value = np.frombuffer(body, kind, 1, offset)[0]
                    offset += kind.itemsize
                table[p[-1]].append(value)
        tables[name] = table
    return tables


_GLB_TYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_GLB_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


def _glb(content: bytes) -> Surface:
    if content[:4] != b"glTF":
        raise ValueError("no glTF mark")
    chunks, offset = [], 12
    while offset < len(content):
        (size,) = struct.unpack_from("<I", content, offset)
        chunks.append(content[offset + 8 : offset + 8 + size])
        offset += 8 + size
    document = json.loads(chunks[0])
    if document.get("extensionsRequired"):
        raise ValueError(f"needs {', '.join(document['extensionsRequired'])}")

    def array(index: int) -> np.ndarray:
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = np.dtype(_GLB_TYPES[accessor["componentType"]])
        width, count = _GLB_WIDTH[accessor["type"]], accessor["count"]
        if not 1 <= count <= _MAX_ELEMENTS:
            raise ValueError(f"{count} elements")
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", width * kind.itemsize)
        if not width * kind.itemsize <= stride <= 252:  # else it would step outside the buffer
            raise ValueError(f"a stride of {stride} bytes")
        raw = np.frombuffer(
            chunks[1], np.uint8, (count - 1) * stride + width * kind.itemsize, start
        )
        strides = (stride, kind.itemsize)
        packed = np.lib.stride_tricks.as_strided(
            raw[: kind.itemsize].view(kind), (count, width), strides, writeable=False
        )
        return np.array(packed)

    vertices, triangles, uv, base = [], [], [], 0
    for node, matrix in _glb_nodes(document):
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", 4) != 4:
                raise ValueError("holds lines or strips")
            attributes = primitive["attributes"]
            points = array(attributes["POSITION"]).astype(np.float64)
            vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
            corners = (
                array(primitive["indices"]).ravel().astype(np.int64)
                if "indices" in primitive
                else np.arange(len(points))
            )
            triangles.append(corners.reshape(-1, 3) + base)
            base += len(points)
            uv.append(array(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None)
    corners = np.concatenate(triangles)
    known = [part for part in uv if part is not None]
    if len(known) < len(uv):
        return Surface(np.concatenate(vertices), corners)
    return Surface(np.concatenate(vertices), corners, np.concatenate(known).astype(float), corners)


def _glb_nodes(document: Any) -> list[tuple[Any, np.ndarray]]:
    """The nodes that carry a mesh, with their matrices to the file's frame: a tree."""
    nodes = document["nodes"]
    children = {child for node in nodes for child in node.get("children", ())}
    found, visited = [], set()
    pending = [(k, np.eye(4)) for k in range(len(nodes)) if k not in children]
    while pending:
        index, above = pending.pop()
        if index in visited:
            raise ValueError("a node has two parents")
        visited.add(index)
        node = nodes[index]
        matrix = above @ _glb_matrix(node)
        pending += [(child, matrix) for child in node.get("children", ())]
        if "mesh" in node:
            found.append((node, matrix))
    return found


def _glb_matrix(node: Any) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= node.get("scale", (1, 1, 1))
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix
