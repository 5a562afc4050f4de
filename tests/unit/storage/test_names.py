"""Names of files that are no text."""

import pytest

from unlit.storage.names import readable


@pytest.mark.parametrize("text", ["a\x1b[2Jb", "a\nb", "a\udcffb", "a\u202eb"])
def test_readable_text_moves_no_cursor(text):
    """Control, direction and broken characters are replaced."""
    assert readable(text).isprintable()
    assert readable("grüße 顔") == "grüße 顔"
