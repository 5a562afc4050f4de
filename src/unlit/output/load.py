"""Read a reconstruction's folder: nothing in it is trusted."""

from __future__ import annotations

from dataclasses import fields as dataclass_fields
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import OutputError, SettingsError
from ..face.conditions import Conditions
from ..face.face import Face, Normals, PosedMesh
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..face.reconstruction import Images, Reconstruction
from ..perception.regions import Regions
from ..photo.crop import Crop
from ..scene.camera import Camera
from ..scene.light import SphericalGaussians
from ..scene.maps import Maps
from ..scene.surface_points import SurfacePoints
from ..settings.settings import PRESETS, Settings, override
from ..storage.folder import MARK
from ..storage.toml import read_toml
from .arrays import read_arrays
from .metrics import read_metrics
from .save import FORMAT

_TEXT_LIMIT = 16 << 20


def load(folder: str | Path) -> Reconstruction:
    """The reconstruction that was saved in `folder`, the same to the bit.

    Raises OutputError that names the file and the field that is missing or wrong.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder; give one that `unlit reconstruct` wrote")
    if not (folder / MARK).exists():
        raise OutputError(
            f"{folder}: not a result of unlit ({MARK} is missing); give a folder that "
            "`unlit reconstruct` wrote"
        )
    fields = _Fields(folder / MARK, _toml(folder / MARK))
    found = fields.get("format", int)
    if found != FORMAT:
        raise OutputError(
            f"{fields.path}: format {found}, this unlit reads {FORMAT}; use the version of unlit "
            "it names, or reconstruct the photo again"
        )
    camera = fields.table("camera")
    width, height = camera.get("width", int), camera.get("height", int)
    pinhole = Camera(width, height, *(camera.number(name) for name in ("focal", "cx", "cy")))
    crop = fields.table("crop")
    resolution = crop.get("resolution", int)
    try:
        square = Crop(np.array(crop.get("matrix", list), dtype=np.float64), resolution)
    except (ValueError, TypeError, IndexError) as error:
        raise crop.wrong("matrix") from error
    arrays = read_arrays(folder / "reconstruction.npz")
    if {width, height, resolution} != {len(arrays["image"])}:
        raise OutputError(
            f"{fields.path}: camera and crop are {width} x {height} and {resolution} pixels, the "
            f"maps {len(arrays['image'])}; reconstruct the photo again"
        )
    color, gain = _light(fields)
    kept = read_metrics(folder / "metrics.json", _text(folder / "metrics.json"))
    regions = Regions(arrays["regions"])
    mesh = PosedMesh(*(arrays[n] for n in ("vertices", "triangles", "uv", "triangle_uv")))
    points = SurfacePoints(arrays["fit_landmark_triangle"], arrays["fit_landmark_barycentric"])
    return Reconstruction(
        FacePhoto(
            fields.get("photo", str),
            arrays["image"],
            pinhole,
            square,
            regions,
            arrays["landmarks"],
            kept.unit_cd_m2,
        ),
        FittedHead(
            replace(mesh, vertices=arrays["fit_vertices"]),
            arrays["fit_landmarks"],
            points,
            kept.landmark_residual,
            kept.head_model,
        ),
        Conditions(color, kept.light_color, arrays.get("visibility")),
        Face(
            pinhole,
            mesh,
            Maps(*(arrays[field.name] for field in dataclass_fields(Maps))),
            Normals(arrays["specular_normal"], arrays["diffuse_normal"]),
            arrays["mask"],
        ),
        SphericalGaussians(
            *(arrays[f"light_{name}"] for name in ("axis", "sharpness", "amplitude")), color=color
        ),
        Images(*(arrays[field.name] for field in dataclass_fields(Images))),
        gain,
        _settings(fields),
        kept.metrics(),
    )


def _settings(fields: _Fields) -> Settings:
    try:
        return override(PRESETS["paper"], fields.get("settings", dict))
    except SettingsError as error:
        raise OutputError(f"{fields.path}: settings: {error}") from error


def _light(fields: _Fields) -> tuple[np.ndarray, float]:
    """Colour (3,) and gain."""
    light = fields.table("light")
    try:
        color = np.array(light.get("color", list), dtype=np.float32)
    except (ValueError, TypeError, OverflowError) as error:
        raise light.wrong("color") from error
    if color.shape != (3,) or not (np.isfinite(color) & (color > 0)).all():
        raise light.wrong("color")
    gain = light.number("gain")
    if not (np.isfinite(gain) and gain > 0):
        raise light.wrong("gain")
    return color, gain


class _Fields:
    """A table of a file; what is missing or of another type is named in the error."""

    def __init__(self, path: Path, values: dict[str, Any], prefix: str = "") -> None:
        self.path = path
        self._values = values
        self._prefix = prefix

    def get(self, name: str, kind: type) -> Any:
        value = self._values.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise self.wrong(name)
        return value

    def number(self, name: str) -> float:
        return float(self.get(name, int | float))  # type: ignore[arg-type]

    def table(self, name: str) -> _Fields:
        return _Fields(self.path, self.get(name, dict), f"{self._prefix}{name}.")

    def wrong(self, name: str) -> OutputError:
        state = "not valid" if name in self._values else "missing"
        return OutputError(
            f"{self.path}: {self._prefix}{name} is {state}; reconstruct the photo again"
        )


def _toml(path: Path) -> dict[str, Any]:
    try:
        return read_toml(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise OutputError(
            f"{path}: no valid TOML ({error}); reconstruct the photo again"
        ) from error


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _TEXT_LIMIT:
            raise OutputError(f"{path}: more than {_TEXT_LIMIT >> 20} MB; not a file of unlit's")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise OutputError(f"{path}: not a text file; reconstruct the photo again") from error
