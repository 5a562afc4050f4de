"""PNG files written by hand: neither decoder may be its own witness."""

import struct
import zlib


def chunk(name, data):
    """One chunk with its length and checksum."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(pixels, colour_type, *chunks):
    """`pixels` (H, W, C) uint8 or uint16 as a PNG of that depth; `chunks` come before the data."""
    bits = 8 * pixels.dtype.itemsize
    lines = b"".join(b"\0" + line.astype(f">u{bits // 8}").tobytes() for line in pixels)
    size = (pixels.shape[1], pixels.shape[0])
    header = struct.pack(">IIBBBBB", *size, bits, colour_type, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + b"".join(chunks)
        + chunk(b"IDAT", zlib.compress(lines))
        + chunk(b"IEND", b"")
    )


def cicp(*codes):
    """The chunk of four code points: primaries, transfer, matrix, full range."""
    return chunk(b"cICP", bytes(codes))


def gama(gamma):
    """The chunk of the encoding exponent."""
    return chunk(b"gAMA", struct.pack(">I", round(100_000 * gamma)))


def chrm(*xy):
    """The chunk of eight numbers: x and y of white, red, green, blue."""
    return chunk(b"cHRM", struct.pack(">8I", *(round(100_000 * value) for value in xy)))


def iccp(profile):
    """The chunk of an ICC profile."""
    return chunk(b"iCCP", b"profile\0\0" + zlib.compress(profile))
