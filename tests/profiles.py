"""ICC profiles made on the fly for the tests, so that no profile file is needed."""

import struct

import numpy as np

# Colorants adapted to D50, as columns: published values of the two colour spaces.
DISPLAY_P3 = np.array(
    [
        [0.515102, 0.291965, 0.157153],
        [0.241182, 0.692236, 0.066582],
        [-0.001050, 0.041882, 0.784378],
    ]
)
SRGB = np.array(
    [
        [0.436066, 0.385147, 0.143066],
        [0.222488, 0.716873, 0.060608],
        [0.013916, 0.097076, 0.714096],
    ]
)
D50 = (0.9642, 1.0, 0.8249)


def _fixed(*values):
    return struct.pack(f">{len(values)}i", *(round(65536 * value) for value in values))


def xyz(values):
    return b"XYZ \0\0\0\0" + _fixed(*values)


def para(kind, *values):
    return b"para\0\0\0\0" + struct.pack(">HH", kind, 0) + _fixed(*values)


def curv(*table):
    return b"curv\0\0\0\0" + struct.pack(f">I{len(table)}H", len(table), *table)


SRGB_CURVE = para(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def build(tags, space=b"RGB ", connection=b"XYZ ", version=0x04300000):
    """A display profile of the given tags {4-byte name: bytes}, readable by LittleCMS too."""
    text = "test".encode("utf-16-be")
    multi = b"mluc\0\0\0\0" + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(text), 28) + text
    tags = {b"desc": multi, b"cprt": multi, b"wtpt": xyz(D50), **tags}
    offset = 132 + 12 * len(tags)
    table, body = struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        data += b"\0" * (-len(data) % 4)
        table += struct.pack(">4sII", name, offset + len(body), len(data))
        body += data
    header = bytearray(128)
    struct.pack_into(">I", header, 0, 128 + len(table) + len(body))
    struct.pack_into(">I4s4s4s", header, 8, version, b"mntr", space, connection)
    struct.pack_into(">6H", header, 24, 2024, 1, 1, 0, 0, 0)
    header[36:40] = b"acsp"
    header[68:80] = _fixed(*D50)
    return bytes(header) + table + body


def matrix(colorants, curve):
    columns = {name: xyz(colorants[:, i]) for i, name in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))}
    return build({**columns, **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve)})


def grey_tables(channels, space, more=()):
    """A profile of tables that shows any ink or light as grey of L = 100 - 100 mean (or mean).

    lut16Type to Lab: 2 grid points a channel, identity curves. more: further tags.
    """
    curve = struct.pack(">2H", 0, 65535)
    points = np.indices((2,) * channels).reshape(channels, -1).T
    levels = points.mean(axis=1) if space == b"RGB " else 1 - points.mean(axis=1)
    nodes = b"".join(struct.pack(">3H", round(0xFF00 * level), 0x8000, 0x8000) for level in levels)
    head = b"mft2" + bytes(4) + bytes((channels, 3, 2, 0)) + _fixed(1, 0, 0, 0, 1, 0, 0, 0, 1)
    lut = head + struct.pack(">2H", 2, 2) + channels * curve + nodes + 3 * curve
    return build({b"A2B0": lut, **dict(more)}, space=space, connection=b"Lab ", version=0x02400000)
