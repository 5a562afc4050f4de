"""Arrays in .npz archives from anywhere: what may go wrong with them, as few kinds of error.

Nothing is unpickled, and an array's header is read first, so that no memory is taken on its word.
"""

from __future__ import annotations

import lzma
import struct
import warnings
import zipfile
import zlib
from typing import IO

import numpy as np

#: What `zipfile` and its decompressors raise on a damaged or hostile archive, besides KeyError for
#: a member that is not there.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, OSError, EOFError),
    *(ValueError, OverflowError, IndexError, RuntimeError, NotImplementedError),
)
_READERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, Fortran order and type of the array in `member`. Raises ValueError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about headers that Python 2 wrote
            return _READERS[np.lib.format.read_magic(member)](member)
    except Exception as error:  # it is parsed as Python, in whose compiler anything may happen
        raise ValueError("its header cannot be read") from error


def reason(error: Exception) -> str:
    """What `error` says, as a short line: it may quote the file's bytes."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else f"{text[:117]}..."
