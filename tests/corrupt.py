"""Damage to files, as hypothesis draws it: flipped bits, cuts, wrong numbers, copied pieces."""

from __future__ import annotations

import struct
from typing import Any

from hypothesis import strategies as st

#: Numbers that counts, sizes and offsets break at.
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF)
_FORMATS = ("<H", ">H", "<I", ">I", "<Q", ">Q")
#: Words that mean something to a reader of text.
_WORDS = (
    *(b"nan", b"inf", b"-1", b"0", b"1e999", b"9" * 30, b"9" * 5000, b"[" * 2000, b'"', b"\0"),
    *(b"{", b"}", b"\n", b"true", b"[]", b"{}", b"\xff\xfe", b"-", b"..", b"/", b"="),
)


@st.composite
def damaged(draw: Any, contents: list[bytes], head: int = 400) -> bytes:
    """One of `contents` with one to eight changes, every other one in its first `head` bytes."""
    data = bytearray(draw(st.sampled_from(contents)))
    for _ in range(draw(st.integers(1, 8))):
        near = draw(st.booleans())
        at = draw(st.integers(0, max(min(len(data), head) if near else len(data), 1) - 1))
        match draw(st.sampled_from(("bit", "byte", "cut", "number", "word", "remove", "copy"))):
            case "bit" if data:
                data[at] ^= 1 << draw(st.integers(0, 7))
            case "byte" if data:
                data[at] = draw(st.integers(0, 255))
            case "cut":
                del data[at:]
            case "number":
                form = draw(st.sampled_from(_FORMATS))
                value = draw(st.sampled_from(_NUMBERS)) % (1 << 8 * struct.calcsize(form))
                data[at : at + struct.calcsize(form)] = struct.pack(form, value)
            case "word":
                data[at : at + draw(st.integers(0, 8))] = draw(st.sampled_from(_WORDS))
            case "remove":
                del data[at : at + draw(st.integers(1, 64))]
            case "copy":
                start = draw(st.integers(0, max(len(data) - 1, 0)))
                data[at:at] = data[start : start + draw(st.integers(1, 64))]
    return bytes(data)
