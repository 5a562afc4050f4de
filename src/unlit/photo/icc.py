"""ICC profiles of photos: from encoded values to linear sRGB.

Cameras, phones and screens describe their colours with three tone curves and a matrix to CIE XYZ
(or one curve for grey). Such a profile is evaluated here in floating point, whatever the bit
depth, and colours outside the gamut of sRGB keep their negative or above-one components. A
profile made of look-up tables (CMYK, scanners) goes through LittleCMS at 8 bits; `photo` does so.

References: ICC.1:2022, sections 7 (layout), 10.6 (curveType), 10.18 (parametricCurveType),
F.3 (three-component matrix-based profiles).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from ..color import decode_srgb

# Colorants of sRGB adapted to the D50 white of the profile connection space, as columns.
_SRGB_TO_D50 = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
# Profiles of sRGB itself differ by rounding and by the table length of their curve. Within these
# bounds (8-bit steps are wider) the standard's own formula is used, so that a picture looks the
# same with such a profile and without one.
_SRGB_MATRIX_TOLERANCE = 2e-3
_SRGB_CURVE_TOLERANCE = 2e-3


class ProfileError(Exception):
    """The bytes are no profile that can be evaluated here."""


@dataclass(frozen=True)
class Profile:
    """Tone curves, and the matrix from the profile's linear colours to linear sRGB.

    curves: (3, N) or, for a grey profile, (1, N) float32: linear value at N encoded values
        spread evenly over [0, 1].
    matrix: (3, 3) float32 linear RGB of the profile to linear sRGB, or None where no change of
        primaries is needed (sRGB itself, grey).
    """

    curves: np.ndarray
    matrix: np.ndarray | None


def srgb_profile(levels: int) -> Profile:
    """sRGB at `levels` encoded values (256 for 8 bits, 65536 for 16)."""
    return Profile(decode_srgb(np.linspace(0, 1, levels))[None].repeat(3, axis=0), None)


def matrix_profile(data: bytes, levels: int) -> Profile:
    """Evaluate the ICC profile `data` of matrix or grey type at `levels` encoded values.

    Raises ProfileError for anything else: damaged bytes, another colour space, look-up tables.
    """
    try:
        return _matrix_profile(data, levels)
    except (struct.error, IndexError, ValueError, np.linalg.LinAlgError) as error:
        raise ProfileError("damaged ICC profile") from error


def _matrix_profile(data: bytes, levels: int) -> Profile:
    if data[36:40] != b"acsp":
        raise ProfileError("no ICC profile")
    space, connection = data[16:20], data[20:24]
    tags = _tags(data)
    encoded = np.linspace(0, 1, levels)
    if space == b"GRAY" and b"kTRC" in tags:
        return Profile(_curve(tags[b"kTRC"], encoded)[None].astype(np.float32), None)
    # A look-up table beside the matrix is the maker's preferred rendering.
    if space != b"RGB " or connection != b"XYZ " or b"A2B0" in tags:
        raise ProfileError("not a matrix profile")
    try:
        colorants = np.stack([_xyz(tags[tag]) for tag in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1)
        curves = np.stack([_curve(tags[tag], encoded) for tag in (b"rTRC", b"gTRC", b"bTRC")])
    except KeyError as error:
        raise ProfileError("not a matrix profile") from error
    matrix = np.linalg.solve(_SRGB_TO_D50, colorants)
    if not (np.isfinite(matrix).all() and np.isfinite(curves).all()):
        raise ProfileError("damaged ICC profile")
    srgb = srgb_profile(levels)
    if (
        np.abs(matrix - np.eye(3)).max() < _SRGB_MATRIX_TOLERANCE
        and np.abs(curves - srgb.curves).max() < _SRGB_CURVE_TOLERANCE
    ):
        return srgb
    return Profile(curves.astype(np.float32), matrix.astype(np.float32))


def hdr_code_points(data: bytes) -> tuple[int, int] | None:
    """Primaries and transfer (ITU-T H.273) of a profile of PQ or HLG; None for any other.

    Such a profile has them in its cicp tag (ICC.1:2022, 9.2.17); its tables are the maker's idea of
    how the highlights are to be squeezed into a display's range.
    """
    try:
        tag = _tags(data).get(b"cicp", b"")
    except struct.error:
        return None
    if tag[:4] != b"cicp" or len(tag) < 12 or tag[9] not in (16, 18):
        return None
    return tag[8], tag[9]


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    tags: dict[bytes, bytes] = {}
    for i in range(min(count, 100)):
        name, offset, size = struct.unpack_from(">4sII", data, 132 + 12 * i)
        tags[name] = data[offset : offset + size]
    return tags


def _xyz(tag: bytes) -> np.ndarray:
    if tag[:4] != b"XYZ ":
        raise ProfileError("not a matrix profile")
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536


def _curve(tag: bytes, x: np.ndarray) -> np.ndarray:
    """Linear values in [0, 1] of the curve `tag` at encoded values x."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return x.copy()
        table = np.frombuffer(tag, ">u2", count, 12).astype(np.float64)
        if count == 1:
            return x ** (table[0] / 256)
        return np.interp(x, np.linspace(0, 1, count), table / 65535)
    if tag[:4] == b"para":
        return _parametric(tag, x)
    raise ProfileError("not a matrix profile")


def _parametric(tag: bytes, x: np.ndarray) -> np.ndarray:
    (kind,) = struct.unpack_from(">H", tag, 8)
    count = (1, 3, 4, 5, 7)[kind]
    g, *rest = (value / 65536 for value in struct.unpack_from(f">{count}i", tag, 12))
    # Unused parameters of the general form y = (a x + b)^g + e for x >= d, c x + f below.
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind in (1, 2):
        a, b = rest[:2]
        if a == 0:
            raise ProfileError("damaged ICC profile")
        d = -b / a
        e = f = rest[2] if kind == 2 else 0.0
    elif kind == 3:
        a, b, c, d = rest
    elif kind == 4:
        a, b, c, d, e, f = rest
    power = np.maximum(a * x + b, 0) ** g + e
    return np.clip(np.where(x >= d, power, c * x + f), 0, 1)
