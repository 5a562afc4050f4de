"""Arrays in .npz files from anywhere, each checked before it is read.

An array's type and size are read from its header and held against a table before any memory is
taken for it; nothing is ever unpickled. What may go wrong comes as few kinds of error.
"""

from __future__ import annotations

import lzma
import struct
import warnings
import zipfile
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from ..errors import OutputError

#: What `zipfile` and its decompressors raise on a damaged or hostile archive, besides KeyError for
#: a member that is not there.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, OSError, EOFError),
    *(ValueError, OverflowError, IndexError, RuntimeError, NotImplementedError),
)
_HEADER_READERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


@dataclass(frozen=True)
class Kind:
    """Shape and type that an array must have; letters stand for sizes that arrays share."""

    shape: tuple[str | int, ...]
    dtype: str = "<f4"


#: Greatest sizes that are read: pixels a side, vertices, triangles, texture coordinates, lobes,
#: landmarks, units of expression and what they move, pixels of a mask, cells of a light, bytes of
#: text.
_SMALL = {"S": 4096, "K": 100_000, "L": 100_000, "M": 100_000, "D": 1_000_000, "E": 1000}
_LIMITS = _SMALL | {
    "V": 4_000_000,
    "F": 8_000_000,
    "T": 8_000_000,
    "N": 64_000_000,
    "P": 4096**2,
    "B": 16 << 20,
}


def read_header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, Fortran order and type of the array in `member`. Raises ValueError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about headers that Python 2 wrote
            return _HEADER_READERS[np.lib.format.read_magic(member)](member)
    except Exception as error:  # it is parsed as Python, in whose compiler anything may happen
        raise ValueError("its header cannot be read") from error


def reason(error: Exception) -> str:
    """What `error` says, as a short line: it may quote the file's bytes."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else f"{text[:117]}..."


def check_indices(path: Path, name: str, index: np.ndarray, size: int, low: int = 0) -> None:
    """Raise OutputError where `index` is not in [low, size)."""
    if index.size and (index.min() < low or index.max() >= size):
        raise OutputError(f"{path}: {name} points outside {low} to {size - 1}")


def read_checked(
    path: Path,
    kinds: Mapping[str, Kind],
    sizes: Mapping[str, int] | None = None,
    *,
    remedy: str,
    optional: Collection[str] = (),
) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """The arrays that `kinds` names, and what the letters of their shapes stand for.

    sizes: letters that are known already. remedy: what to do about a broken file. optional: names
    that may be missing. Raises OutputError that names the file and the array.
    """
    found: dict[str, np.ndarray] = {}
    known = dict(sizes or {})
    name = "the file"
    try:
        with zipfile.ZipFile(path) as archive:
            members = set(archive.namelist())
            for name, kind in kinds.items():
                if name in optional and f"{name}.npy" not in members:
                    continue
                with archive.open(f"{name}.npy") as member:
                    shape = _check_header(member, path, name, kind, known)
                with archive.open(f"{name}.npy") as member:
                    found[name] = np.lib.format.read_array(member, allow_pickle=False)
                if found[name].shape != shape:
                    raise ValueError("it changed while it was read")
    except KeyError as error:
        raise OutputError(f"{path}: {name} is missing; {remedy}") from error
    except FileNotFoundError as error:
        raise OutputError(f"{path}: no such file; {remedy}") from error
    except DAMAGED as error:
        what = f"{name} is damaged or cut off ({reason(error)})"
        raise OutputError(f"{path}: {what}; {remedy}") from error
    return found, known


def _check_header(
    member: IO[bytes], path: Path, name: str, kind: Kind, sizes: dict[str, int]
) -> tuple[int, ...]:
    """Shape of the array in `member`; `sizes` collects what the letters of the table stand for."""
    shape, _, dtype = read_header(member)
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
