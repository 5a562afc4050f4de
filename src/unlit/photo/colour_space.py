"""Colour spaces that a file names by numbers: code points, or chromaticities and an exponent.

HEIC and AVIF (`nclx`), PNG (`cICP`) and video share the code points of ITU-T H.273. They say which
primaries and white the values mean and by which curve they were encoded. The result is a `Profile`
as of an ICC profile: curves to linear values, and a matrix to linear sRGB.

Two curves reach beyond the white of a page. A photo's 1 is then their reference white, and what is
brighter is above 1 (ITU-R BT.2408-7, section 2: 203 cd/m^2 in PQ, the signal 0.75 in HLG):

- PQ (BT.2100-2, table 4) codes the light of a display: its EOTF over 203 cd/m^2; at most 49.3.
- HLG (BT.2100-2, table 5) codes the light of the scene: the inverse OETF over its value at 0.75; at
  most 3.77. The display's OOTF is not applied, since the scene's light is what is wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..color import decode_srgb
from .icc import Profile, ProfileError, srgb_profile

#: (x, y) of red, green, blue and white.
Chromaticities = tuple[float, float, float, float, float, float, float, float]
#: Linear values of encoded ones, float64 of any shape, 0 to 1 or a little beyond.
Decode = Callable[[np.ndarray], np.ndarray]

#: The white of sRGB, (x, y).
D65 = (0.3127, 0.3290)
SRGB: Chromaticities = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *D65)
BT2020: Chromaticities = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65)
#: H.273, table 2. Code 10 has primaries without a y, and is of cinemas only.
_PRIMARIES: dict[int, Chromaticities] = {
    1: SRGB,
    4: (0.67, 0.33, 0.21, 0.71, 0.14, 0.08, 0.310, 0.316),
    5: (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, *D65),
    6: (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *D65),
    7: (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *D65),
    8: (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, 0.310, 0.316),
    9: BT2020,
    11: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351),
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65),
    22: (0.630, 0.340, 0.295, 0.605, 0.155, 0.077, *D65),
}
UNSPECIFIED = 2
_SRGB_CODES = (1, 13)

#: Cone responses by which whites are adapted (Bradford; ICC.1:2022, annex E.3).
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
#: Chromaticities rounded to three or four digits still mean sRGB.
_SRGB_TOLERANCE = 2e-3
#: Signals of limited range reach a little above 1.
_HIGHEST_SIGNAL = 1.1
_PQ_WHITE = 203.0
_HLG_WHITE = 0.75


@dataclass(frozen=True)
class ColourSpace:
    """What encoded values mean.

    name: for the log. chromaticities: of the primaries and the white. decode: the curve to linear
    values, where 1 is white. limited: whether black and white are 16 and 235 of 255, as in video,
    instead of 0 and 255 (H.273, section 8.3, full range flag 0).
    """

    name: str
    chromaticities: Chromaticities
    decode: Decode
    limited: bool = False

    def profile(self, white: int) -> Profile:
        """The profile at the encoded values 0 to `white`, which is 255 or more.

        Raises ProfileError where the chromaticities are no colours that can be told apart.
        """
        encoded = np.arange(white + 1) / white
        if self.limited:
            low, high = (level << white.bit_length() - 8 for level in (16, 235))
            encoded = (encoded * white - low) / (high - low)
        curve = self.decode(np.clip(encoded, 0, _HIGHEST_SIGNAL)).astype(np.float32)
        if not np.isfinite(curve).all():
            raise ProfileError("a curve without end")
        matrix = _to_srgb(self.chromaticities)
        plain = np.abs(matrix - np.eye(3)).max() < _SRGB_TOLERANCE
        if plain and self.decode is decode_srgb and not self.limited:
            return srgb_profile(white + 1)
        curves = curve[None].repeat(3, axis=0)
        return Profile(curves, None if plain else matrix.astype(np.float32))


def coded_space(primaries: int, transfer: int, full_range: bool = True) -> ColourSpace | None:
    """The colour space of two code points of H.273, tables 2 and 3; None where both say nothing.

    One that is unspecified (2) is that of sRGB. Raises ProfileError for codes that are not read.
    """
    if primaries == transfer == UNSPECIFIED and full_range:
        return None
    name = f"code points {primaries}/{transfer}"
    if primaries == UNSPECIFIED:
        primaries = _SRGB_CODES[0]
    if transfer == UNSPECIFIED:
        transfer = _SRGB_CODES[1]
    if primaries not in _PRIMARIES or transfer not in _TRANSFERS:
        raise ProfileError(f"{name} of ITU-T H.273 are not supported")
    return ColourSpace(name, _PRIMARIES[primaries], _TRANSFERS[transfer], not full_range)


def power(exponent: float) -> Decode:
    """The curve linear = encoded^exponent."""
    return lambda encoded: encoded**exponent


def bt709(encoded: np.ndarray) -> np.ndarray:
    """Inverse of the camera's curve (OETF) of BT.709, BT.601 and BT.2020: linear scene light."""
    above = np.maximum(encoded, 0.081)
    return np.where(encoded < 0.081, encoded / 4.5, ((above + 0.099) / 1.099) ** (1 / 0.45))


def pq(encoded: np.ndarray) -> np.ndarray:
    """EOTF of PQ (BT.2100-2, table 4; SMPTE ST 2084) over reference white, 203 cd/m^2."""
    m1, m2 = 2610 / 16384, 2523 / 4096 * 128
    c1, c2, c3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    root = np.clip(encoded, 0, 1) ** (1 / m2)
    light = (np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1)
    return 10000 / _PQ_WHITE * light


def hlg(encoded: np.ndarray) -> np.ndarray:
    """Inverse OETF of HLG (BT.2100-2, table 5), scene light, over that of the signal 0.75."""
    return _hlg_scene(encoded) / _hlg_scene(np.float64(_HLG_WHITE))


def _hlg_scene(encoded: np.ndarray | np.float64) -> np.ndarray:
    a = 0.17883277
    b = 1 - 4 * a
    c = 0.5 - a * np.log(4 * a)
    above = np.maximum(encoded, 0.5)
    return np.where(encoded <= 0.5, encoded**2 / 3, (np.exp((above - c) / a) + b) / 12)


#: H.273, table 3. Its 1, 6, 14 and 15 are one curve, written with more or fewer digits.
_TRANSFERS: dict[int, Decode] = {
    **dict.fromkeys((1, 6, 14, 15), bt709),
    4: power(2.2),
    5: power(2.8),
    8: power(1.0),
    13: decode_srgb,
    16: pq,
    18: hlg,
}


#: Adobe RGB (1998), sections 4.3.1.1 and 4.3.4.2.
ADOBE_RGB = ColourSpace(
    "Adobe RGB (EXIF)", (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *D65), power(563 / 256)
)


def _to_srgb(chromaticities: Chromaticities) -> np.ndarray:
    """Matrix (3, 3) from linear values of these primaries to linear sRGB; white becomes white."""
    try:
        own, white = _to_xyz(chromaticities)
        srgb, d65 = _to_xyz(SRGB)
        gains = (_BRADFORD @ d65) / (_BRADFORD @ white)
        adapted = np.linalg.solve(_BRADFORD, gains[:, None] * (_BRADFORD @ own))
        matrix = np.linalg.solve(srgb, adapted)
    except (ZeroDivisionError, np.linalg.LinAlgError) as error:
        raise ProfileError("primaries that are no colours") from error
    if not np.abs(matrix).max() < 100:  # nor is it a number
        raise ProfileError("primaries that can hardly be told apart")
    return matrix


def _to_xyz(chromaticities: Chromaticities) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (3, 3) to CIE XYZ with Y = 1 for white, and white's XYZ."""
    pairs = list(zip(chromaticities[::2], chromaticities[1::2], strict=True))
    *colours, white = (np.array([x / y, 1, (1 - x - y) / y]) for x, y in pairs)
    columns = np.stack(colours, axis=1)
    return columns * np.linalg.solve(columns, white), white
