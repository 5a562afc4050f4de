"""subject.toml: the description of a scanned head. docs/evaluation.md writes the format out.

The types of the fields are the checks; every error names the file and the field.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct, field

from ..errors import SubjectError
from ..scene.camera import Camera
from ..storage.pictures import read_picture
from ..storage.tables import array, place_of, read_toml, typed

UNITS = {"mm": 0.1, "cm": 1.0, "m": 100.0}
_Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Pixels = Annotated[int, Meta(ge=16, le=65536)]
_Albedo = Annotated[float, Meta(ge=0, le=4)]
_Encoding = Literal["srgb", "linear"]


class Table(Struct, forbid_unknown_fields=True, frozen=True):
    """A table of the file; unknown fields are refused, since most are misspelt."""


class Film(Table, kw_only=True, frozen=True):
    """The table `camera`: a square film, its lens, and the pose in units of the world."""

    width: _Pixels
    fov_x: Annotated[float, Meta(ge=0.1, le=170)] | None = None
    focal: Annotated[float, Meta(ge=1, le=1e7)] | None = None
    cx: _Number | None = None
    cy: _Number | None = None
    camera_to_world: np.ndarray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if (self.fov_x is None) == (self.focal is None):
            raise ValueError("give either fov_x in degrees or focal in pixels")
        turn = self.camera_to_world[:3, :3]
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3):
            raise ValueError("camera_to_world must be a rotation and a shift, without scale")
        if np.linalg.det(turn) < 0:
            raise ValueError("camera_to_world mirrors; its axes must be right-handed")

    def pinhole(self) -> Camera:
        """The camera without its pose."""
        half = self.width / 2
        focal = self.focal or half / math.tan(math.radians(self.fov_x or 0) / 2)
        cx, cy = (half if centre is None else centre for centre in (self.cx, self.cy))
        return Camera(self.width, self.width, focal, cx, cy)


class Map(Table, kw_only=True, frozen=True):
    """A map of reflectance: a picture, or one value for all of the mesh."""

    file: Path | None = None
    encoding: _Encoding | None = None
    scale: _Number = 1.0
    value: Any = None

    def __post_init__(self) -> None:
        if not (self.file is None) == (self.encoding is None) == (self.value is not None):
            raise ValueError("give either value, or file and encoding")

    def pixels(self) -> np.ndarray:
        """(h, w, C), decoded, times `scale`."""
        if self.file is None:
            image = np.array(self.value, dtype=np.float64).reshape(1, 1, -1)
        else:
            image = read_picture(self.file, self.encoding or "linear")
        return image * np.float32(self.scale)


class DiffuseAlbedo(Map, kw_only=True, frozen=True):
    """Linear sRGB."""

    value: tuple[_Albedo, _Albedo, _Albedo] | None = None


class SpecularAlbedo(Map, kw_only=True, frozen=True):
    """Factor on the Beckmann lobe."""

    value: Annotated[float, Meta(ge=0, le=20)] | None = None


class Roughness(Map, kw_only=True, frozen=True):
    """Beckmann's alpha."""

    value: Annotated[float, Meta(ge=0.02, le=1)] | None = None


class NormalMap(Table, frozen=True):
    """A picture of n / 2 + 1 / 2."""

    file: Path
    space: Literal["tangent", "object"]
    green: Literal["up", "down"] = "up"


class Displacement(Table, kw_only=True, frozen=True):
    """Moves vertices by scale (value - middle), after splits of every triangle in four."""

    file: Path
    encoding: _Encoding
    scale: _Number
    middle: _Number = 0.5
    subdivisions: Annotated[int, Meta(ge=0, le=6)] = 2


class MeshTable(Table, kw_only=True, frozen=True):
    """A table `mesh`. v_axis: where v = 1 is on the maps; None: as its format has it."""

    file: Path
    diffuse_albedo: DiffuseAlbedo
    specular_albedo: SpecularAlbedo | None = None
    roughness: Roughness | None = None
    normal: NormalMap | None = None
    displacement: Displacement | None = None
    v_axis: Literal["up", "down"] | None = None

    def pictures(self) -> list[Path]:
        """The files of its maps."""
        maps = (self.diffuse_albedo, self.specular_albedo, self.roughness)
        every = (*maps, self.normal, self.displacement)
        return [found.file for found in every if found is not None and found.file is not None]


class SubjectFile(Table, kw_only=True, frozen=True):
    """The whole file. units: centimetres in one unit of the world, or its name."""

    format: Literal[1]
    name: Annotated[str, Meta(min_length=1)]
    credit: str = ""
    units: Literal["mm", "cm", "m"] | Annotated[float, Meta(ge=1e-6, le=1e6)]
    object_to_world: np.ndarray = field(default_factory=lambda: np.eye(4))
    frontal: bool = False
    camera: Film | None = None
    mesh: Annotated[list[MeshTable], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if self.frontal == (self.camera is not None):
            raise ValueError("camera: give a [camera] table, or frontal = true, and not both")

    @property
    def unit(self) -> float:
        """Centimetres in one unit of the world."""
        return UNITS[self.units] if isinstance(self.units, str) else self.units


def read_subject_file(file: Path) -> SubjectFile:
    """The description `file`, or in the folder `file`. Raises SubjectError."""
    file = description(file)

    def decode(kind: Any, value: Any) -> Any:
        if kind is not Path:
            return _matrix(array(kind, value))
        if not isinstance(value, str) or not (file.parent / value).is_file():
            raise ValueError(f"there is no file {value!r} beside it")
        return file.parent / value

    try:
        return typed(read_toml(file, SubjectError), SubjectFile, decode)
    except ValueError as error:
        fields = "docs/evaluation.md lists the fields"
        place = place_of(file, str(error).partition(": ")[0])
        raise SubjectError(f"{place}: {error}; {fields}") from error


def description(file: Path) -> Path:
    """subject.toml where `file` is a folder."""
    return file / "subject.toml" if file.is_dir() else file


def files_of(file: Path) -> list[Path]:
    """The description and every file it names, for a content key. Raises SubjectError."""
    meshes = read_subject_file(file).mesh
    return [description(file), *(path for mesh in meshes for path in (mesh.file, *mesh.pictures()))]


def _matrix(matrix: np.ndarray) -> np.ndarray:
    """`matrix`, (4, 4) with a last row of 0 0 0 1, that can be inverted. Raises ValueError."""
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError("must be four rows of four numbers")
    if not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise ValueError("must end with the row [0, 0, 0, 1]; is it transposed?")
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-12:
        raise ValueError("cannot be inverted")
    return matrix
