"""Steps are kept by content: done once, done again when an input changes, whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from unlit.errors import OutputError
from unlit.evaluate.step_cache import StepCache


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

    steps = StepCache(tmp_path / "a" / "b", Busy)
    first = steps.picture("photo", "k1", make)
    again = StepCache(tmp_path / "a" / "b").picture("photo", "k1", make)
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

    steps = StepCache(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        steps.picture("photo", "k", interrupted)
    assert not list(tmp_path.iterdir())


def test_never_unpickles(tmp_path: Path) -> None:
    """A cached file that holds objects is made anew, not opened."""
    np.save(tmp_path / "photo-k.npy", np.array([{}], dtype=object), allow_pickle=True)
    assert StepCache(tmp_path).picture("photo", "k", lambda: np.ones(2)).sum() == 2


def test_a_file_where_the_folder_should_be(tmp_path: Path) -> None:
    """One line that names it."""
    (tmp_path / "steps").write_text("")
    with pytest.raises(OutputError, match="steps: cannot be made"):
        StepCache(tmp_path / "steps")
