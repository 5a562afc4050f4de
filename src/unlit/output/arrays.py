"""reconstruction.npz: every array of a reconstruction, each checked before it is read.

An array's type and size are read from its header and held against the table below before any
memory is taken for it; nothing is ever unpickled.
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from ..errors import OutputError
from ..reconstruction import Reconstruction


@dataclass(frozen=True)
class _Kind:
    shape: tuple[str | int, ...]
    dtype: str = "<f4"


#: Greatest sizes that are read: pixels a side, vertices, triangles, texture coordinates, lobes.
_LIMITS = {"S": 4096, "V": 4_000_000, "F": 8_000_000, "T": 8_000_000, "K": 100_000}

_COLOUR, _SCALAR = _Kind(("S", "S", 3)), _Kind(("S", "S"))
_KINDS = {
    "image": _COLOUR,
    "vertices": _Kind(("V", 3)),
    "triangles": _Kind(("F", 3), "<i4"),
    "uv": _Kind(("T", 2)),
    "triangle_uv": _Kind(("F", 3), "<i4"),
    "diffuse_albedo": _COLOUR,
    "specular_albedo": _SCALAR,
    "roughness": _SCALAR,
    "perturbation": _COLOUR,
    "specular_normal": _COLOUR,
    "diffuse_normal": _COLOUR,
    "diffuse_shading": _COLOUR,
    "specular_shading": _COLOUR,
    "render": _COLOUR,
    "mask": _SCALAR,
    "regions": _Kind(("S", "S", 6)),
    "light_axis": _Kind(("K", 3)),
    "light_sharpness": _Kind(("K",)),
    "light_amplitude": _Kind(("K",)),
}
_INDEXED = {"triangles": "V", "triangle_uv": "T"}
_DAMAGED = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError)


def write_arrays(reconstruction: Reconstruction, path: Path) -> None:
    """Write the arrays of `reconstruction`, not compressed: floats of a photo hardly shrink."""
    arrays = {
        name: np.asarray(_attribute(reconstruction, name), dtype=kind.dtype)
        for name, kind in _KINDS.items()
    }
    np.savez(path, allow_pickle=False, **arrays)


def _attribute(reconstruction: Reconstruction, name: str) -> np.ndarray:
    if name.startswith("light_"):
        return getattr(reconstruction.light, name.removeprefix("light_"))
    return getattr(reconstruction, name)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays by name. Raises OutputError that names the file and the array."""
    found: dict[str, np.ndarray] = {}
    sizes: dict[str, int] = {}
    name = "the file"
    try:
        with zipfile.ZipFile(path) as archive:
            for name, kind in _KINDS.items():
                with archive.open(f"{name}.npy") as member:
                    shape = _check_header(member, path, name, kind, sizes)
                with archive.open(f"{name}.npy") as member:
                    found[name] = np.lib.format.read_array(member, allow_pickle=False)
                if found[name].shape != shape:
                    raise ValueError("it changed while it was read")
    except KeyError as error:
        raise OutputError(f"{path}: {name} is missing; reconstruct the photo again") from error
    except FileNotFoundError as error:
        raise OutputError(f"{path}: no such file; reconstruct the photo again") from error
    except _DAMAGED as error:
        raise OutputError(
            f"{path}: {name} is damaged or cut off ({error}); reconstruct the photo again"
        ) from error
    for name, size in _INDEXED.items():
        index = found[name]
        if index.size and (index.min() < 0 or index.max() >= sizes[size]):
            raise OutputError(f"{path}: {name} points outside 0 to {sizes[size] - 1}")
    return found


def _check_header(
    member: IO[bytes], path: Path, name: str, kind: _Kind, sizes: dict[str, int]
) -> tuple[int, ...]:
    """Shape of the array in `member`; `sizes` collects what the letters of the table stand for."""
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(np.lib.format.read_magic(member))
    if read is None:
        raise ValueError("its version is not known")
    shape, _, dtype = read(member)
    if dtype != np.dtype(kind.dtype):
        raise OutputError(f"{path}: {name} has type {dtype}, expected {np.dtype(kind.dtype)}")
    wanted = " x ".join(str(size) for size in kind.shape)
    if len(shape) != len(kind.shape):
        raise OutputError(f"{path}: {name} has shape {shape}, expected {wanted}")
    for length, size in zip(shape, kind.shape, strict=True):
        known = size if isinstance(size, int) else sizes.get(size, length)
        if length != known:
            raise OutputError(
                f"{path}: {name} has shape {shape}, expected {wanted}, {size} {known}"
            )
        if isinstance(size, str):
            if not 1 <= length <= _LIMITS[size]:
                raise OutputError(
                    f"{path}: {name} has shape {shape}; {size} is 1 to {_LIMITS[size]}"
                )
            sizes[size] = length
    return shape
