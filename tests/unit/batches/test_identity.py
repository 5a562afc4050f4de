"""By what a batch knows a photo that is done."""

import os

from unlit.batches.record import with_photo
from unlit.storage.identity import Identity

COMMON = Identity("", "", "only", "", {}, "h", "1", "k", "llvm")


def test_a_photo_is_known_by_its_bytes_and_name(tmp_path):
    """Not by its date or folder."""
    one, same, other = (tmp_path / name for name in ("a.jpg", "b/a.jpg", "c/a.jpg"))
    for path, content in ((one, b"same"), (same, b"same"), (other, b"else")):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    first = with_photo(COMMON, one)
    assert first is not None
    assert (first.photo, first.head) == ("a.jpg", "h")
    assert first == with_photo(COMMON, same)
    found = with_photo(COMMON, other)
    assert found is not None
    assert first.difference(found) == "another photo of that name"


def test_none_without_a_photo(tmp_path):
    """Missing files, folders, and pipes, which would never end."""
    os.mkfifo(tmp_path / "pipe.jpg")
    for name in ("pipe.jpg", "none.jpg", "."):
        assert with_photo(COMMON, tmp_path / name) is None
