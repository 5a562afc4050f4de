"""reconstruction.toml: what a result's arrays belong to, and the settings it was made with."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tomli_w

from ..errors import OutputError
from ..face.reconstruction import Reconstruction
from ..photo.crop import Crop
from ..scene.camera import Camera
from ..settings.settings import as_dict
from ..storage.folder import MARK_TEXT
from ..storage.tables import read_toml, typed

#: Version of reconstruction.toml and .npz.
FORMAT = 2

_HEAD = (
    f"{MARK_TEXT}. Read it with unlit.load; the arrays are in reconstruction.npz.\n"
    "# camera: focal, cx, cy in pixels of the crop. crop.matrix: photo to crop pixels.\n"
    "# light: color in linear sRGB; albedo was multiplied by gain, the light divided by it.\n\n"
)
_AGAIN = "reconstruct the photo again"
_Positive = Annotated[float, msgspec.Meta(gt=0, lt=1e38)]


@dataclass(frozen=True)
class LightTable:
    """The light's colour, linear sRGB, and Reconstruction.gain."""

    color: tuple[_Positive, _Positive, _Positive]
    gain: _Positive


@dataclass(frozen=True)
class ResultFile:
    """The file's content. unlit: the version that wrote it. files: what each file holds."""

    format: int
    unlit: str
    photo: str
    camera: Camera
    crop: Crop
    light: LightTable
    settings: dict[str, Any]
    files: dict[str, str]


def result_toml(r: Reconstruction, files: dict[str, str]) -> str:
    """The file's text."""
    file = ResultFile(
        FORMAT,
        version("unlit"),
        r.photo.name,
        r.face.camera,
        r.photo.crop,
        LightTable(tuple(r.light.color.tolist()), r.gain),
        as_dict(r.settings),
        files,
    )
    return _HEAD + tomli_w.dumps(msgspec.to_builtins(file, enc_hook=lambda value: value.tolist()))


def read_result_file(path: Path) -> ResultFile:
    """The content of `path`. Raises OutputError that names the field."""
    values = read_toml(path, OutputError)
    found = values.get("format", FORMAT)
    if found != FORMAT:
        raise OutputError(
            f"{path}: format {found!r}, this unlit reads {FORMAT}; use the version of unlit it "
            f"names, or {_AGAIN}"
        )
    try:
        file = typed(values, ResultFile)
    except ValueError as error:
        raise OutputError(f"{path}: {error}; {_AGAIN}") from error
    if not file.camera.width == file.camera.height == file.crop.resolution:
        raise OutputError(
            f"{path}: camera and crop are {file.camera.width} x {file.camera.height} and "
            f"{file.crop.resolution} pixels; {_AGAIN}"
        )
    return file
