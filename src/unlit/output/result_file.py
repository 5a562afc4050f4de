"""reconstruction.toml: what a result's arrays belong to, and the settings it was made with."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

import msgspec
import numpy as np
import tomli_w

from ..errors import OutputError
from ..face.reconstruction import Reconstruction
from ..photo.crop import Crop
from ..scene.camera import Camera
from ..settings.ranges import expected
from ..settings.settings import as_dict
from ..storage.folder import MARK_TEXT
from ..storage.tables import place_of, read_toml, typed

#: Version of reconstruction.toml and .npz.
FORMAT = 2

_HEAD = (
    f"{MARK_TEXT}. Read it with unlit.load; the arrays are in reconstruction.npz.\n"
    "# camera: focal, cx, cy in pixels of the crop. crop.matrix: photo to crop pixels.\n"
    "# light: color in linear sRGB; albedo was multiplied by gain, the light divided by it.\n\n"
)
_AGAIN = "reconstruct the photo again"
_Positive = Annotated[float, msgspec.Meta(gt=0, lt=1e38)]
_Side = Annotated[int, msgspec.Meta(ge=1, le=4096)]
_Coordinate = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]


class _Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of the file: a field that is not known is a mistake in one that is."""


class CameraTable(_Table, frozen=True):
    """The fields of Camera, pixels, and what they may be."""

    width: _Side
    height: _Side
    #: Less is no angle of view that can be rendered.
    focal: Annotated[float, msgspec.Meta(ge=1, le=1e6)]
    cx: _Coordinate
    cy: _Coordinate


class CropTable(_Table, frozen=True):
    """The fields of Crop."""

    matrix: tuple[tuple[_Coordinate, _Coordinate, _Coordinate], ...]
    resolution: _Side


class LightTable(_Table, frozen=True):
    """The light's colour, linear sRGB, and Reconstruction.gain."""

    color: tuple[_Positive, _Positive, _Positive]
    gain: _Positive


class HeadTable(_Table, frozen=True):
    """units: names of the head's expression units, none where no head was fitted."""

    units: tuple[str, ...] = ()


class ResultTable(_Table, frozen=True):
    """The file as it is written. unlit: the version that wrote it. files: what each file holds."""

    format: int
    unlit: str
    photo: str
    camera: CameraTable
    crop: CropTable
    light: LightTable
    settings: dict[str, Any]
    files: dict[str, str]
    head: HeadTable = HeadTable()


@dataclass(frozen=True)
class ResultFile:
    """The file's content, as what the result is made of."""

    photo: str
    camera: Camera
    crop: Crop
    light: LightTable
    settings: dict[str, Any]
    units: tuple[str, ...]


def result_toml(r: Reconstruction, files: dict[str, str]) -> str:
    """The file's text."""
    file = ResultTable(
        FORMAT,
        version("unlit"),
        r.photo.name,
        CameraTable(**vars(r.face.camera)),
        CropTable(tuple(map(tuple, r.photo.crop.matrix.tolist())), r.photo.crop.resolution),
        LightTable(tuple(r.light.color.tolist()), r.gain),
        as_dict(r.settings),
        files,
        HeadTable(r.head.motion.names if r.head.motion else ()),
    )
    return _HEAD + tomli_w.dumps(msgspec.to_builtins(file))


def read_result_file(path: Path) -> ResultFile:
    """The content of `path`. Raises OutputError that names the line, the field and its range."""
    values = read_toml(path, OutputError)
    found = values.get("format", FORMAT)
    if found != FORMAT:
        raise OutputError(
            f"{path}: format {found!r}, this unlit reads {FORMAT}; use the version of unlit it "
            f"names, or {_AGAIN}"
        )
    try:
        table = typed(values, ResultTable)
    except ValueError as error:
        raise _wrong(path, str(error)) from error
    camera = Camera(**msgspec.to_builtins(table.camera))
    try:
        crop = Crop(np.array(table.crop.matrix), table.crop.resolution)
    except ValueError as error:
        raise _wrong(path, f"crop.matrix: {error}") from error
    file = ResultFile(table.photo, camera, crop, table.light, table.settings, table.head.units)
    if not file.camera.width == file.camera.height == file.crop.resolution:
        raise OutputError(
            f"{path}: camera and crop are {file.camera.width} x {file.camera.height} and "
            f"{file.crop.resolution} pixels; {_AGAIN}"
        )
    return file


def _wrong(path: Path, error: str) -> OutputError:
    """The error of a field, "camera.focal: Expected `float` >= 1.0", with its line and range."""
    name, _, what = error.partition(": ")
    kind: Any = ResultTable
    for part in name.split("."):
        inside = get_type_hints(kind, include_extras=True) if isinstance(kind, type) else {}
        kind = inside.get(part)
    if get_origin(kind) is Annotated:
        what = f"expected {expected(kind)}"
    return OutputError(f"{place_of(path, name)}: {name}: {what}; mend the line, or {_AGAIN}")
