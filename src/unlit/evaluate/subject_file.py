"""subject.toml: the description of a scanned head, checked field by field.

The format is written out in docs/evaluation.md. Every error names the file and the field.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SubjectError
from ..scene.camera import Camera
from ..scene.normals import vertex_normals
from ..settings.settings import ROUGHNESS
from ..storage.meshes import V_AXIS, Surface, read_mesh
from ..storage.pictures import read_picture
from ..storage.toml import read_toml
from .scan import Part, Scan, frontal, seen_by

FORMAT = 1
UNITS = {"mm": 0.1, "cm": 1.0, "m": 100.0}
_MAX_TRIANGLES = 20_000_000
_MAPS = ("diffuse_albedo", "specular_albedo", "roughness", "normal", "displacement")
_ABSENT: Any = object()


class Table:
    """A table of the file that knows its own name, hands out checked values, and in the end
    refuses what nobody asked for."""

    def __init__(self, file: Path, name: str, values: Any) -> None:
        self.file, self.name, self.asked = file, name, set()
        if not isinstance(values, dict):
            self.fail("", "must be a table")
        self.values: dict[str, Any] = values

    def fail(self, field: str, what: str) -> Any:
        """Raise SubjectError about `field`."""
        full = ".".join(part for part in (self.name, field) if part)
        raise SubjectError(f"{self.file}: {full or 'the file'}: {what}")

    def get(self, field: str, default: Any = _ABSENT) -> Any:
        """The raw value; without `default` the field must be there."""
        self.asked.add(field)
        if field not in self.values and default is _ABSENT:
            self.fail(field, "is missing")
        return self.values.get(field, default)

    def table(self, field: str) -> Table | None:
        """A sub-table, or None."""
        value = self.get(field, None)
        return None if value is None else Table(self.file, self._inner(field), value)

    def tables(self, field: str) -> list[Table]:
        """An array of tables, at least one."""
        value = self.get(field)
        if not isinstance(value, list) or not value:
            self.fail(field, f"must be one or more [[{field}]] tables")
        return [
            Table(self.file, f"{self._inner(field)}[{k}]", part) for k, part in enumerate(value)
        ]

    def text(self, field: str, default: Any = _ABSENT) -> str:
        """A string."""
        value = self.get(field, default)
        if not isinstance(value, str) or not value:
            self.fail(field, "must be text in quotes")
        return value

    def choice(self, field: str, known: Any, default: Any = _ABSENT) -> str:
        """One of `known`."""
        value = self.get(field, default)
        if value not in tuple(known):
            self.fail(field, f"is {value!r}; choose {' or '.join(map(repr, known))}")
        return value

    def number(
        self, field: str, low: float, high: float, default: float = _ABSENT, whole: bool = False
    ) -> float:
        """A finite number in [low, high]."""
        value = self.get(field, default)
        kinds = (int,) if whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds) or not _finite(value):
            self.fail(field, f"is {value!r}; must be a {'whole ' if whole else ''}number")
        if not low <= value <= high:
            self.fail(field, f"is {value}; must be from {low} to {high}")
        return value

    def truth(self, field: str, default: bool) -> bool:
        """true or false."""
        value = self.get(field, default)
        if not isinstance(value, bool):
            self.fail(field, "must be true or false")
        return value

    def matrix(self, field: str) -> np.ndarray:
        """(4, 4) float64 with a last row of 0 0 0 1 that can be inverted; default identity."""
        value = self.get(field, None)
        if value is None:
            return np.eye(4)
        try:
            matrix = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            matrix = np.zeros(0)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            self.fail(field, "must be four rows of four numbers")
        if not np.allclose(matrix[3], (0, 0, 0, 1)):
            self.fail(field, "must end with the row [0, 0, 0, 1]; is it transposed?")
        if abs(np.linalg.det(matrix[:3, :3])) < 1e-12:
            self.fail(field, "cannot be inverted")
        return matrix

    def path(self, field: str) -> Path:
        """A file, relative to the description's folder."""
        path = self.file.parent / self.text(field)
        if not path.is_file():
            self.fail(field, f"there is no file {path}")
        return path

    def done(self) -> None:
        """Refuse fields that are not of the format: most are misspelt."""
        unknown = sorted(self.values.keys() - self.asked)
        if unknown:
            self.fail(unknown[0], f"is not a field here; known are {', '.join(sorted(self.asked))}")

    def _inner(self, field: str) -> str:
        return f"{self.name}.{field}" if self.name else field


def read_subject(file: Path, size: int) -> Scan:
    """The subject that `file` describes, on a film of `size` x `size` pixels.

    file: a subject.toml, or the folder that holds one. Raises SubjectError.
    """
    file = file / "subject.toml" if file.is_dir() else file
    top = Table(file, "", _parse(file))
    top.number("format", FORMAT, FORMAT, whole=True)
    name = top.text("name")
    top.text("credit", name)
    unit = _unit(top)
    pose = top.matrix("object_to_world")
    face_front = top.truth("frontal", False)
    camera = top.table("camera")
    if face_front == (camera is not None):
        top.fail("camera", "give a [camera] table, or frontal = true, and not both")
    meshes = top.tables("mesh")
    top.done()
    parts = tuple(_part(mesh, pose, unit) for mesh in meshes)
    if camera is None:
        return frontal(name, parts, size)
    return seen_by(name, parts, *_camera(camera, unit), size)


def files_of(file: Path) -> list[Path]:
    """`file` and every file it names, for a content key. Raises SubjectError."""
    file = file / "subject.toml" if file.is_dir() else file
    found = [file]

    def walk(value: Any) -> None:
        if isinstance(value, dict):
            named = value.get("file")
            if isinstance(named, str) and (file.parent / named).is_file():
                found.append(file.parent / named)
            for inner in value.values():
                walk(inner)
        elif isinstance(value, list):
            for inner in value:
                walk(inner)

    walk(_parse(file))
    return found


def _parse(file: Path) -> dict[str, Any]:
    try:
        return read_toml(file)
    except OSError as error:
        raise SubjectError(f"{file}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise SubjectError(f"{file}: no valid TOML ({error})") from error


def _finite(value: float) -> bool:
    """Neither nan nor infinite; TOML's whole numbers may be too large for a float."""
    return -math.inf < value < math.inf


def _unit(top: Table) -> float:
    """Centimetres in one unit of the world."""
    value = top.get("units")
    if isinstance(value, str):
        return UNITS[top.choice("units", UNITS)]
    return top.number("units", 1e-6, 1e6)


def _camera(table: Table, unit: float) -> tuple[Camera, np.ndarray]:
    """The pinhole camera and its pose, cm."""
    width = int(table.number("width", 16, 65536, whole=True))
    height = int(table.number("height", 16, 65536, width, whole=True))
    if height != width:
        table.fail("height", f"is {height}; the film must be as high as wide ({width})")
    if ("fov_x" in table.values) == ("focal" in table.values):
        table.fail("fov_x", "give either fov_x in degrees or focal in pixels")
    if "fov_x" in table.values:
        half = math.radians(table.number("fov_x", 0.1, 170) / 2)
        focal = 0.5 * width / math.tan(half)
    else:
        focal = table.number("focal", 1, 1e7)
    cx = table.number("cx", -1e6, 1e6, width / 2)
    cy = table.number("cy", -1e6, 1e6, width / 2)
    pose = table.matrix("camera_to_world")
    table.done()
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3):
        table.fail("camera_to_world", "must be a rotation and a shift, without scale")
    if np.linalg.det(pose[:3, :3]) < 0:
        table.fail("camera_to_world", "mirrors; its axes must be right-handed")
    pose[:3, 3] *= unit
    return Camera(width, width, focal, cx, cy), pose


def _part(table: Table, object_to_world: np.ndarray, unit: float) -> Part:
    path = table.path("file")
    axis = table.choice("v_axis", ("up", "down"), V_AXIS.get(path.suffix.lower(), "up"))
    maps = {name: table.table(name) for name in _MAPS}
    if maps["diffuse_albedo"] is None:
        table.fail("diffuse_albedo", "is missing")
    table.done()
    surface = read_mesh(path)
    textured = any(m is not None and "file" in m.values for m in maps.values())
    if textured and surface.uv is None:
        table.fail("file", f"{path} has no texture coordinates, but maps are given")
    vertices, uv, triangles, smooth = _unified(surface, axis)
    bend = _image(maps["normal"], _normal_map, np.array([0.0, 0.0, 1.0]))
    in_object = maps["normal"] is not None and maps["normal"].values.get("space") == "object"
    if maps["displacement"] is not None:
        vertices, uv, triangles, smooth = _displaced(
            maps["displacement"], vertices, uv, triangles, smooth
        )
    if np.linalg.det(object_to_world[:3, :3]) < 0:  # a mirrored head, turned right side out
        triangles = triangles[:, ::-1]
    linear = object_to_world[:3, :3] * unit
    world = vertices @ linear.T + object_to_world[:3, 3] * unit
    return Part(
        vertices=world,
        normals=vertex_normals(world, triangles, smooth),
        triangles=triangles,
        uv=uv,
        diffuse=_image(maps["diffuse_albedo"], _colour, None),
        specular=_image(maps["specular_albedo"], _scalar(0, 20), np.array([1.0])),
        roughness=_image(maps["roughness"], _scalar(0.02, 1), np.array([ROUGHNESS["skin"]])),
        normal=bend @ np.linalg.inv(linear) if in_object else bend,
        object_space=in_object,
    )


def _image(
    table: Table | None, read: Callable[[Table], np.ndarray], default: np.ndarray | None
) -> np.ndarray:
    """(h, w, C): the map of `table`; without one the constant `default`."""
    if table is None:
        assert default is not None
        return default.reshape(1, 1, -1).astype(np.float32)
    image = read(table)
    table.done()
    return image.astype(np.float32)


def _pixels(table: Table) -> np.ndarray:
    """The picture of a map, decoded, times its `scale`."""
    encoding = table.choice("encoding", ("srgb", "linear"))
    scale = table.number("scale", -1e6, 1e6, 1.0)
    return read_picture(table.path("file"), encoding) * np.float32(scale)


def _colour(table: Table) -> np.ndarray:
    if "value" in table.values:
        value = table.get("value")
        numbers = isinstance(value, list) and all(
            isinstance(x, int | float) and not isinstance(x, bool) and 0 <= x <= 4 for x in value
        )
        if not numbers or len(value) != 3:
            table.fail("value", "must be three numbers from 0 to 4, linear sRGB")
        value = np.array([[value]], dtype=np.float64)
    else:
        value = _pixels(table)
    if value.min() < 0 or value.max() > 4:
        table.fail("scale", f"gives albedos from {value.min():.2f} to {value.max():.2f}")
    return np.clip(value, 0, 1)


def _scalar(low: float, high: float) -> Callable[[Table], np.ndarray]:
    def read(table: Table) -> np.ndarray:
        if "value" in table.values:
            return np.array([[[table.number("value", low, high)]]])
        return np.clip(_pixels(table).mean(axis=2, keepdims=True), low, high)

    return read


def _normal_map(table: Table) -> np.ndarray:
    """(h, w, 3) vectors from a picture of n / 2 + 1 / 2; green up."""
    table.choice("space", ("tangent", "object"))
    green = table.choice("green", ("up", "down"), "up")
    normal = 2 * read_picture(table.path("file")) - 1
    return normal * (1, 1 if green == "up" else -1, 1)


def _unified(surface: Surface, axis: str) -> tuple[np.ndarray, ...]:
    """Vertices, uv with v up, triangles into both, and for each vertex its smooth point's number.

    Vertices are split where the texture is cut, and belong to one smooth point where they lie
    together, so that shading does not show the cuts.
    """
    if surface.uv is None or surface.triangle_uv is None:
        uv, corner_uv = np.zeros((1, 2)), np.zeros_like(surface.triangles)
    else:
        uv, corner_uv = surface.uv.copy(), surface.triangle_uv
        if axis == "down":
            uv[:, 1] = 1 - uv[:, 1]
    pairs = np.stack([surface.triangles.ravel(), corner_uv.ravel()], axis=1)
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    vertices = surface.vertices[unique[:, 0]]
    grain = 1e-6 * float(np.ptp(surface.vertices, axis=0).max())
    _, smooth = np.unique(np.round(vertices / grain), axis=0, return_inverse=True)
    return vertices, uv[unique[:, 1]], index.reshape(-1, 3), smooth.ravel()


def _displaced(
    table: Table, vertices: np.ndarray, uv: np.ndarray, triangles: np.ndarray, smooth: np.ndarray
) -> tuple[np.ndarray, ...]:
    """The mesh split `subdivisions` times and moved along its normals by the map."""
    times = int(table.number("subdivisions", 0, 6, 2, whole=True))
    middle = table.number("middle", -1e6, 1e6, 0.5)
    scale = table.number("scale", -1e6, 1e6)
    image = read_picture(table.path("file"), table.choice("encoding", ("srgb", "linear")))
    table.done()
    if len(triangles) * 4**times > _MAX_TRIANGLES:
        table.fail("subdivisions", f"is {times}; that makes over {_MAX_TRIANGLES} triangles")
    normals = vertex_normals(vertices, triangles, smooth)
    for _ in range(times):
        triangles, ends = _split(triangles)
        vertices, uv, normals = (
            np.concatenate([x, x[ends].mean(axis=1)]) for x in (vertices, uv, normals)
        )
        low, high = np.sort(smooth[ends], axis=1).T
        key = low * (int(smooth.max()) + 1) + high
        _, middle_point = np.unique(key, return_inverse=True)
        smooth = np.concatenate([smooth, int(smooth.max()) + 1 + middle_point.ravel()])
    height, width = image.shape[:2]
    # Pixel centres; v = 0 is the bottom row.
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fx, fy = x - left, y - top
    grey = image.mean(axis=2)
    value = (grey[top, left] * (1 - fx) + grey[top, right] * fx) * (1 - fy)
    value += (grey[bottom, left] * (1 - fx) + grey[bottom, right] * fx) * fy
    # Copies of one point across a cut of the texture must not part.
    count = np.bincount(smooth)
    value = (np.bincount(smooth, value) / np.maximum(count, 1))[smooth]
    return vertices + normals * (scale * (value - middle))[:, None], uv, triangles, smooth


def _split(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every triangle in four: new triangles, and the ends (E, 2) of the edges with new vertices."""
    first = int(triangles.max()) + 1
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
    ends, middle = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    m = first + middle.reshape(-1, 3)
    a, b, c = triangles.T
    quarters = [(a, m[:, 0], m[:, 2]), (m[:, 0], b, m[:, 1]), (m[:, 2], m[:, 1], c), m.T]
    return np.concatenate([np.stack(q, axis=1) for q in quarters]), ends
