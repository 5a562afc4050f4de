"""Names of files as text: a file system takes any bytes, a page or a terminal does not."""

from __future__ import annotations


def readable(text: str) -> str:
    """`text` that a page, table or terminal takes.

    Names may hold control characters, or bytes that are no text.
    """
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in text)
