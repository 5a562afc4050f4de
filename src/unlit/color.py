"""The one place where colours are encoded and decoded: sRGB by IEC 61966-2-1.

Inside unlit every colour is linear, with the primaries and white point of sRGB. Encoded values
exist at the edges only: 8-bit networks, PNG previews, and the image loss.
"""

from __future__ import annotations

from typing import Any

import numpy as np

# Rec. 709 / sRGB luminance of the linear primaries (second row of the RGB to XYZ matrix).
LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)

_A = 0.055
_SLOPE = 12.92
_GAMMA = 2.4
_KNEE_LINEAR = 0.0031308
_KNEE_ENCODED = 0.04045


#: A white light's colour, linear sRGB.
WHITE = np.ones(3, dtype=np.float32)
#: sRGB-encoded values that a photo can tell apart; below it is crushed, above it is saturated.
UNCLIPPED = (0.004, 0.996)


def encode_srgb(linear: Any) -> np.ndarray:
    """Encode linear sRGB, any shape, to sRGB values, float32; [0, 1] maps onto [0, 1].

    Values above 1 continue on the power curve. Negative values, which lie outside the gamut of
    sRGB, follow the linear segment through zero. The result is monotonic and inverted by
    `decode_srgb`.
    """
    values: np.ndarray = np.asarray(linear, dtype=np.float32)
    # The power curve is evaluated at the knee or above only, so it never sees a negative base.
    above = np.maximum(values, np.float32(_KNEE_LINEAR))
    curve = (1 + _A) * above ** np.float32(1 / _GAMMA) - _A
    return np.where(values <= _KNEE_LINEAR, values * np.float32(_SLOPE), curve).astype(np.float32)


def decode_srgb(encoded: Any) -> np.ndarray:
    """Decode sRGB values, any shape, to linear sRGB, float32: the inverse of `encode_srgb`."""
    values: np.ndarray = np.asarray(encoded, dtype=np.float32)
    above = np.maximum(values, np.float32(_KNEE_ENCODED))
    curve = ((above + _A) / (1 + _A)) ** np.float32(_GAMMA)
    return np.where(values <= _KNEE_ENCODED, values / np.float32(_SLOPE), curve).astype(np.float32)


def is_white(color: np.ndarray) -> bool:
    """Whether a light of this colour (3,) leaves what it lights as it is."""
    return bool((color == 1).all())


def luminance(rgb: Any) -> np.ndarray:
    """Relative luminance (...), float32, of linear sRGB colours (..., 3)."""
    return np.asarray(rgb, dtype=np.float32) @ np.asarray(LUMINANCE_WEIGHTS, dtype=np.float32)
