"""Steps are kept by content: done once, done again when an input changes, whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from unlit.errors import OutputError
from unlit.evaluate import store
from unlit.evaluate.store import RECONSTRUCTION, RENDERING, Store, code, key


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


def test_code_includes_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A head model that is exchanged changes the key, as a line of source does."""
    monkeypatch.setattr(store, "_PACKAGE", tmp_path)
    (tmp_path / "head").mkdir()
    keys = set()
    for name, content in (("a.py", b"1"), ("a.npz", b"1"), ("a.npz", b"2"), ("a.txt", b"")):
        (tmp_path / "head" / name).write_bytes(content)
        keys.add(code.__wrapped__(("head",)))
    assert len(keys) == 3


def test_done_once(tmp_path: Path) -> None:
    """The second call reads; another content, or a damaged file, makes it anew."""
    said: list[str] = []
    calls: list[int] = []

    class Busy:
        def __init__(self, name: str) -> None:
            said.append(name)

        def __enter__(self) -> None: ...

        def __exit__(self, *_: object) -> None: ...

    def make() -> np.ndarray:
        calls.append(1)
        return np.arange(6.0).reshape(2, 3)

    steps = Store(tmp_path / "a" / "b", Busy)
    first = steps.picture("photo", "k1", make)
    again = Store(tmp_path / "a" / "b").picture("photo", "k1", make)
    assert np.array_equal(first, again)
    assert (len(calls), said) == (1, ["photo"])
    steps.picture("photo", "k2", make)
    assert len(calls) == 2
    (tmp_path / "a/b/photo-k1.npy").write_bytes(b"\x93NUMPY cut")
    assert np.array_equal(steps.picture("photo", "k1", make), first)
    assert len(calls) == 3
    values = {"psnr": 31.25, "name": "x", "none": None}
    assert steps.values("metrics", "k", lambda: values) == values
    assert steps.values("metrics", "k", dict) == values
    (tmp_path / "a/b/metrics-k.json").write_text("{")
    assert steps.values("metrics", "k", lambda: {"a": 1}) == {"a": 1}


def test_a_step_that_fails_leaves_nothing(tmp_path: Path) -> None:
    """An interrupted step is done again next time, not half read."""

    def interrupted() -> np.ndarray:
        raise KeyboardInterrupt

    steps = Store(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        steps.picture("photo", "k", interrupted)
    assert not list(tmp_path.iterdir())


def test_never_unpickles(tmp_path: Path) -> None:
    """A cached file that holds objects is made anew, not opened."""
    np.save(tmp_path / "photo-k.npy", np.array([{}], dtype=object), allow_pickle=True)
    assert Store(tmp_path).picture("photo", "k", lambda: np.ones(2)).sum() == 2


def test_a_file_where_the_folder_should_be(tmp_path: Path) -> None:
    """One line that names it."""
    (tmp_path / "steps").write_text("")
    with pytest.raises(OutputError, match="steps: cannot be made"):
        Store(tmp_path / "steps")
