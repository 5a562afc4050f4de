"""The morphable head model (paper section 2.1) and its file format, docs/head-model-format.md.

    S = S0 + B_id a + B_exp b

Where models come from: `sources`.
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ModelError
from ..scene.surface_points import SurfacePoints
from ..storage.arrays import DAMAGED, read_header, reason

VERTEX_REGIONS = ("skin", "lips", "eyes", "eyebrows", "mouth", "scalp", "neck", "ears", "teeth")
LANDMARKS = 478
FORMAT = "unlit-head-model"
FORMAT_VERSION = 1
# The largest sensible model: a scan-resolution mesh with a few hundred components.
MAX_VERTICES = 500_000
MAX_FILE_BYTES = 2 << 30


@dataclass(frozen=True)
class HeadModel:
    """A linear head model in its own frame.

    Model frame: right-handed, x towards the image's right when the face is seen from the front
    (the subject's left), y up, the face looks along +z; centimetres.

    name, licence, origin: str, one line each.
    neutral: (V, 3) float32, the mean adult with a relaxed, closed mouth and open eyes.
    identity: (I, V, 3) float32, the displacement of one standard deviation of each component;
        the coefficients are independent and standard normal.
    expression: (E, V, 3) float32, the displacement of each unit at full strength; coefficients
        lie in [0, 1].
    expression_names: E distinct names, those of ARKit's 52 face units where a unit is one of them.
    triangles: (F, 3) int32 into the vertices, counter-clockwise seen from outside.
    uv: (T, 2) float32 texture coordinates, v up.
    triangle_uv: (F, 3) int32 into uv.
    landmark_points: where the 478 landmarks lie on the mesh; in a file the two arrays
        `landmark_triangle` and `landmark_barycentric`.
    vertex_region: (V,) uint8 index into VERTEX_REGIONS.

    Raises ModelError, naming the field, when the arrays do not fit together.
    """

    name: str
    licence: str
    origin: str
    neutral: np.ndarray
    identity: np.ndarray
    expression: np.ndarray
    expression_names: tuple[str, ...]
    triangles: np.ndarray
    uv: np.ndarray
    triangle_uv: np.ndarray
    landmark_points: SurfacePoints
    vertex_region: np.ndarray

    def __post_init__(self) -> None:
        content = self.content()
        _validate(content)
        for value in content.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def content(self) -> dict[str, Any]:
        """What a file holds of the model, by its names there."""
        content = {field.name: getattr(self, field.name) for field in fields(self)}
        points: SurfacePoints = content.pop("landmark_points")
        content["landmark_triangle"] = points.triangle
        content["landmark_barycentric"] = points.barycentric
        return content

    @cached_property
    def basis(self) -> np.ndarray:
        """(I + E, V, 3) float32: the displacements of identity and expression."""
        return np.concatenate([self.identity, self.expression])

    def vertices(self, identity: np.ndarray, expression: np.ndarray) -> np.ndarray:
        """Vertices (V, 3), float32, model frame, of identity (I,) and expression (E,)."""
        identity = np.asarray(identity, dtype=np.float32)
        expression = np.asarray(expression, dtype=np.float32)
        moved = np.tensordot(identity, self.identity, axes=1)
        return self.neutral + moved + np.tensordot(expression, self.expression, axes=1)

    def landmarks(self, vertices: np.ndarray) -> np.ndarray:
        """Landmark points (478, 3) on `vertices` (V, 3), any frame; NaN where there is none."""
        return self.landmark_points.on(vertices, self.triangles)

    def save(self, path: str | Path) -> None:
        """Write the documented .npz, replacing `path` only once it is complete."""
        path = Path(path)
        part = path.with_name(f"{path.name}.{os.getpid()}.part")  # others may build it, too
        values = self.content() | {"format": FORMAT, "version": FORMAT_VERSION}
        try:
            with part.open("wb") as file:  # `savez` would add a suffix to the path
                np.savez(file, **values)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)

    @staticmethod
    def load(path: str | Path) -> HeadModel:
        """Read a model file; raises ModelError when it is not one, naming the faulty field."""
        path = Path(path)
        try:
            arrays = _read_npz(path)
        except FileNotFoundError:
            raise ModelError(f"{path}: no such head model file") from None
        except (KeyError, *DAMAGED) as error:
            raise ModelError(f"{path}: not a head model file ({reason(error)})") from None
        if str(arrays.get("format")) != FORMAT:
            raise ModelError(f"{path}: not a head model file (field 'format' is not {FORMAT!r})")
        version = arrays["version"].tolist() if "version" in arrays else None
        if version != FORMAT_VERSION:
            raise ModelError(
                f"{path}: head model format version {version} is not supported; "
                f"convert it to version {FORMAT_VERSION}"
            )
        try:
            return _of_arrays(arrays)
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None


def _of_arrays(arrays: dict[str, np.ndarray]) -> HeadModel:
    """The model of a file's arrays. Raises ModelError that names the field."""
    values: dict[str, Any] = dict(arrays)
    try:
        values |= {text: str(values[text]) for text in ("name", "licence", "origin")}
        names = np.atleast_1d(values["expression_names"])
        values["expression_names"] = tuple(str(name) for name in names)
        points = SurfacePoints(values["landmark_triangle"], values["landmark_barycentric"])
        values["landmark_points"] = points
        return HeadModel(**{field.name: values[field.name] for field in fields(HeadModel)})
    except KeyError as error:
        raise ModelError(f"field {error} is missing from the head model") from None


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    """Arrays of an .npz file, each checked against its header before memory is set aside."""
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > MAX_FILE_BYTES:
            raise ValueError(f"larger than {MAX_FILE_BYTES >> 30} GB")
        for entry in archive.infolist():
            with archive.open(entry) as member:
                shape, fortran, dtype = read_header(member)
            size = np.prod(shape, dtype=np.float64) * dtype.itemsize
            if dtype.hasobject or fortran or size > entry.file_size:
                raise ValueError(f"array {entry.filename} does not fit its header")
            with archive.open(entry) as member:
                array = np.lib.format.read_array(member, allow_pickle=False)
            arrays[entry.filename.removesuffix(".npy")] = array
    return arrays


def _validate(content: dict[str, Any]) -> None:
    """Raise ModelError at the first field whose type, shape or values are wrong."""

    def check(condition: object, field: str, problem: str) -> None:
        if not condition:
            raise ModelError(f"head model field '{field}' {problem}")

    def array(field: str, kind: str, *shape: int | None) -> np.ndarray:
        value = content[field]
        check(isinstance(value, np.ndarray) and value.dtype == kind, field, f"must be {kind}")
        fits = value.ndim == len(shape) and all(
            want is None or have == want for have, want in zip(value.shape, shape, strict=True)
        )
        wanted = ", ".join("any" if side is None else str(side) for side in shape)
        check(fits, field, f"has shape {value.shape}, expected ({wanted})")
        if kind == "float32":
            check(np.isfinite(value).all(), field, "holds values that are not finite")
        return value

    def index(field: str, limit: int, lowest: int, *shape: int | None) -> np.ndarray:
        value = array(field, "int32", *shape)
        inside = value.size == 0 or (value.min() >= lowest and value.max() < limit)
        check(inside, field, f"holds indices outside {lowest}..{limit - 1}")
        return value

    for field in ("name", "licence", "origin"):
        text = content[field]
        check(isinstance(text, str) and text.isprintable(), field, "must be one line of text")
    count = len(array("neutral", "float32", None, 3))
    check(3 <= count <= MAX_VERTICES, "neutral", f"has {count} vertices, at most {MAX_VERTICES}")
    array("identity", "float32", None, count, 3)
    units = len(array("expression", "float32", None, count, 3))
    names = content["expression_names"]
    check(
        isinstance(names, tuple) and len(names) == len(set(names)) == units,
        "expression_names",
        f"must hold {units} distinct names",
    )
    faces = len(index("triangles", count, 0, None, 3))
    check(faces > 0, "triangles", "is empty")
    corners = len(array("uv", "float32", None, 2))
    index("triangle_uv", corners, 0, faces, 3)
    carried = index("landmark_triangle", faces, -1, LANDMARKS) >= 0
    weights = array("landmark_barycentric", "float32", LANDMARKS, 3)[carried]
    unity = np.abs(weights.sum(axis=-1) - 1).max(initial=0) < 1e-3
    check(unity, "landmark_barycentric", "holds weights that do not sum to 1")
    region = array("vertex_region", "uint8", count)
    check(
        region.max() < len(VERTEX_REGIONS),
        "vertex_region",
        f"holds indices outside 0..{len(VERTEX_REGIONS) - 1}",
    )
