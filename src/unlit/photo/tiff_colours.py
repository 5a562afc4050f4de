"""The colour space that a TIFF's tags name, where it has no ICC profile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from ..color import decode_srgb
from .colour_space import D65, SRGB, Chromaticities, ColourSpace, Decode
from .icc import ProfileError

_TRANSFER_FUNCTION, _WHITE_POINT, _PRIMARIES = 301, 318, 319


def tiff_space(tags: Mapping[int, Any]) -> ColourSpace | None:
    """The colour space of TransferFunction, WhitePoint and PrimaryChromaticities; None without any.

    TIFF 6.0, section 20. What is missing is that of sRGB. tags: by number. Raises ProfileError for
    values that are no colours, and for curves that differ by channel.
    """
    curve, white, primaries = (
        cast("tuple[float, ...] | None", tags.get(tag))
        for tag in (_TRANSFER_FUNCTION, _WHITE_POINT, _PRIMARIES)
    )
    if not (curve or white or primaries):
        return None
    xy = (*(primaries or SRGB[:6]), *(white or D65))
    try:
        colours = tuple(float(value) for value in xy)
    except (TypeError, ValueError, ZeroDivisionError) as error:
        raise ProfileError("tags of colours that are no numbers") from error
    if len(colours) != len(SRGB):
        raise ProfileError("tags of colours with a wrong count of numbers")
    return ColourSpace(
        "TIFF tags", cast(Chromaticities, colours), _table(curve) if curve else decode_srgb
    )


def _table(curve: tuple[float, ...]) -> Decode:
    """The curve of linear values, 0 to 65535, evenly spread over the encoded ones."""
    values = np.array(curve, dtype=np.float64) / 65535
    if len(values) % 3 == 0:  # one for each channel; the length of one is a power of 2
        each = values.reshape(3, -1)
        if not (each == each[0]).all():
            raise ProfileError("curves that differ by channel in TransferFunction")
        values = each[0]
    if len(values) < 2:
        raise ProfileError("a TransferFunction without a curve")
    return lambda encoded: np.interp(encoded, np.linspace(0, 1, len(values)), values)
