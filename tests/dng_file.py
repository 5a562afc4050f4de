"""A DNG file of one mosaic, written by hand: a camera of known primaries."""

import struct

import numpy as np

#: Linear sRGB and Display P3 to CIE XYZ; the inverse is what DNG wants, from XYZ to the camera.
SRGB_TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_SHORT, _LONG = 3, 4
P3_TO_XYZ = np.array(
    [
        [0.4865709, 0.2656677, 0.1982173],
        [0.2289746, 0.6917385, 0.0792869],
        [0, 0.0451134, 1.0439444],
    ]
)


def _rationals(values):
    return b"".join(struct.pack("<ii", round(10_000 * value), 10_000) for value in values)


def mosaic(colour, height=80, width=100):
    """(H, W) float: red, green / green, blue of one colour, 0 to 1."""
    found = np.full((height, width), colour[1], float)
    found[0::2, 0::2], found[1::2, 1::2] = colour[0], colour[2]
    return found


def dng(pixels, neutral=(1, 1, 1), orientation=1, to_xyz=SRGB_TO_XYZ):
    """`pixels` (H, W), 0 to 1 as the sensor saw them; `neutral`: what it saw of white."""
    height, width = pixels.shape
    body = np.rint(65535 * pixels).astype("<u2").tobytes()
    matrix = _rationals(np.linalg.inv(to_xyz).ravel())
    entries = [
        (254, _LONG, 1, 0),
        (256, _LONG, 1, width),
        (257, _LONG, 1, height),
        (258, _SHORT, 1, 16),
        (259, _SHORT, 1, 1),
        (262, _SHORT, 1, 32803),
        (271, 2, 5, b"Test\0"),
        (272, 2, 5, b"Test\0"),
        (273, _LONG, 1, None),
        (274, _SHORT, 1, orientation),
        (277, _SHORT, 1, 1),
        (278, _LONG, 1, height),
        (279, _LONG, 1, len(body)),
        (33421, _SHORT, 2, struct.pack("<HH", 2, 2)),
        (33422, 1, 4, bytes((0, 1, 1, 2))),
        (50706, 1, 4, bytes((1, 4, 0, 0))),
        (50708, 2, 5, b"Test\0"),
        (50717, _LONG, 1, 65535),
        (50721, 10, 9, matrix),
        (50728, 5, 3, _rationals(neutral)),
        (50778, _SHORT, 1, 21),
    ]
    start = 8 + 2 + 12 * len(entries) + 4
    values = [value for *_, value in entries if isinstance(value, bytes) and len(value) > 4]
    strip = start + sum(len(value) + len(value) % 2 for value in values)
    table, extra = b"", b""
    for tag, kind, count, value in entries:
        if isinstance(value, bytes) and len(value) > 4:
            field = struct.pack("<I", start + len(extra))
            extra += value + bytes(len(value) % 2)
        elif isinstance(value, bytes):
            field = value
        else:
            field = struct.pack("<I", strip if value is None else value)
        table += struct.pack("<HHI", tag, kind, count) + field
    return struct.pack("<4sIH", b"II*\0", 8, len(entries)) + table + bytes(4) + extra + body
