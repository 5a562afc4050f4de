"""Fingerprints differ with everything that decides a result."""

from pathlib import Path

import numpy as np
import pytest

from unlit.storage import keys
from unlit.storage.keys import RECONSTRUCTION, RENDERING, code, key


def test_key() -> None:
    """Differs with every content, type and shape; is the same for equal content."""
    zero = np.zeros(4, np.float32)
    parts = [(zero,), (zero[:2],), (zero.reshape(2, 2),), (zero.view(np.int32),), (b"ab",)]
    parts += [("ab",), (b"a", b"b"), ({"a": 1, "b": 2},), (None,), (0,)]
    assert len({key(*part) for part in parts}) == len(parts)
    assert key({"a": 1, "b": 2}) == key({"b": 2, "a": 1})
    assert key(zero) == key(np.zeros(8, np.float32)[::2])


def test_code() -> None:
    """Names that do not exist would make every key blind to changes of the source."""
    nothing = code(("no_such_folder",))
    for parts in (RENDERING, RECONSTRUCTION):
        assert all(code((part,)) != nothing for part in parts)


def test_code_knows_every_room() -> None:
    """A new part of the package has to be said to decide a reconstruction, or only to show it."""
    showing = {"batches", "cli", "evaluate", "output", "progress", "relighting", "report"}
    showing |= {"__init__.py", "__main__.py", "api.py", "errors.py"}
    found = {path.name for path in keys._PACKAGE.iterdir() if not path.name.startswith("__py")}
    found -= {"py.typed"}
    assert found - showing == set(RECONSTRUCTION)


def test_code_includes_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A head model that is exchanged changes the key, as a line of source does."""
    monkeypatch.setattr(keys, "_PACKAGE", tmp_path)
    (tmp_path / "head").mkdir()
    found = set()
    for name, content in (("a.py", b"1"), ("a.npz", b"1"), ("a.npz", b"2"), ("a.txt", b"")):
        (tmp_path / "head" / name).write_bytes(content)
        found.add(code.__wrapped__(("head",)))
    assert len(found) == 3
