"""The colour space that a PNG's chunks name, besides an ICC profile."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

from ..color import decode_srgb
from .colour_space import SRGB, ColourSpace, coded_space, power
from .icc import ProfileError

_SIGNATURE = 8
#: What writers of sRGB put into gAMA, where the exact curve cannot be said.
_SRGB_GAMMA = 0.45455
_SRGB_GAMMA_TOLERANCE = 5e-4
#: Outside, it is a wrong entry.
_GAMMAS = (0.1, 10.0)


def png_code_points(data: bytes) -> ColourSpace | None:
    """The colour space of the file's cICP chunk, which goes before an ICC profile; None without.

    PNG, third edition, 11.3.2.6. Raises ProfileError for one that cannot be read: values that are
    no RGB, code points that are not known, or bytes that are cut off.
    """
    at = _SIGNATURE
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IDAT":
            return None
        if kind == b"cICP":
            content = data[at + 8 : at + 8 + size]
            if size != 4 or len(content) != 4:
                raise ProfileError("a damaged cICP chunk")
            primaries, transfer, matrix, full_range = content
            if matrix != 0 or full_range > 1:
                raise ProfileError(f"the cICP chunk {'/'.join(map(str, content))} is not RGB")
            return coded_space(primaries, transfer, bool(full_range))
        at += 12 + size
    return None


def png_gamma_space(info: Mapping[str, Any]) -> ColourSpace | None:
    """The colour space of gAMA and cHRM in Pillow's `info` of a PNG; None where nothing is said.

    An sRGB chunk goes before them (PNG, third edition, 4.3). Either may be missing: the curve, or
    the primaries, are then those of sRGB. So is the curve where gAMA is 0.45455, which writers of
    sRGB pictures put there. A gAMA of 0 says nothing (13.13). Raises ProfileError for one that is
    out of any range.
    """
    gamma, chromaticities = info.get("gamma"), info.get("chromaticity")
    if "srgb" in info or not (gamma or chromaticities):
        return None
    decode = decode_srgb
    if gamma and abs(gamma - _SRGB_GAMMA) > _SRGB_GAMMA_TOLERANCE:
        if not _GAMMAS[0] <= gamma <= _GAMMAS[1]:
            raise ProfileError(f"gAMA is {gamma:g}, not between 0.1 and 10")
        decode = power(1 / gamma)
    said = [f"gAMA {gamma:g}"] if gamma else []
    colours = SRGB
    if chromaticities:
        # Pillow has the white first.
        white, primaries = chromaticities[:2], chromaticities[2:8]
        colours = (*primaries, *white)
        said.append("cHRM")
    return ColourSpace(" and ".join(said), colours, decode)
