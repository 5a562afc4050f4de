"""Results appear whole or not at all, and nobody's files are lost."""

import errno
import os
import resource
import shutil
import signal
from collections import namedtuple
from pathlib import Path

import pytest

from unlit.errors import OutputError
from unlit.storage.folder import (
    CHECKPOINT,
    MARK,
    MARK_TEXT,
    reserve,
    write_all,
    write_one,
    write_several,
)

OLD, NEW = f"{MARK_TEXT} old", f"{MARK_TEXT} new"


def writers(text: str, *names: str):
    return {name: lambda path: path.write_text(text) for name in (MARK, *names)}


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_a_result_replaces_an_older_one_and_keeps_other_files(tmp_path):
    """The user's own notes beside a result survive a second run; the result is replaced."""
    folder = tmp_path / "a" / "b"
    write_all(folder, writers(OLD, "mask.png"))
    (folder / "notes.txt").write_text("mine")
    write_all(folder, writers(NEW, "mask.png"))
    assert contents(folder) == {MARK: NEW, "mask.png": NEW, "notes.txt": "mine"}


def test_obsolete_files_go_only_if_they_are_ours(tmp_path):
    """A user's own report.html in a folder without a result is not a page of an older result."""
    (tmp_path / "page.html").write_text("mine")
    write_all(tmp_path, writers(OLD), obsolete=("page.html",))
    assert contents(tmp_path) == {MARK: OLD, "page.html": "mine"}
    write_all(tmp_path, writers(NEW), obsolete=("page.html",))
    assert contents(tmp_path) == {MARK: NEW}


def test_somebody_elses_file_is_not_overwritten(tmp_path):
    """A folder without our mark may hold a mask.png of the user's own."""
    (tmp_path / "mask.png").write_text("mine")
    with pytest.raises(OutputError, match=r"holds mask\.png.*choose another folder"):
        write_all(tmp_path, writers(NEW, "mask.png"))
    assert contents(tmp_path) == {"mask.png": "mine"}


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), ValueError("bug")])
def test_a_failing_writer_leaves_the_old_result_and_no_trace(tmp_path, failure):
    """Whatever goes wrong half-way, the older result stays and a new folder disappears."""

    def fail(path: Path) -> None:
        path.write_text("half")
        raise failure

    old = tmp_path / "old"
    write_all(old, writers(OLD, "mask.png"))
    for folder in (old, tmp_path / "new" / "deep"):
        with pytest.raises(type(failure)):
            write_all(folder, {**writers(NEW), "mask.png": fail})
    assert contents(old) == {MARK: OLD, "mask.png": OLD}
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


def test_a_write_the_system_refuses_is_one_line_and_leaves_no_trace(tmp_path):
    """A real refusal: the process may not write files over 1,000 bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OutputError, match=r"new: .*ulimit -f"):
            write_all(tmp_path / "new", writers(NEW + "." * 5000, "mask.png"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_names_the_remedy(tmp_path):
    """ENOSPC from any writer."""

    def full(path: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OutputError, match="the disk is full; free some room"):
        write_all(tmp_path / "new", {MARK: full})


def test_ctrl_c_waits_until_all_files_are_in_place(tmp_path, monkeypatch, request):
    """An interrupt between two moves would leave a mixture of two results."""
    move = Path.replace

    def interrupted(self: Path, target: Path) -> Path:
        signal.raise_signal(signal.SIGINT)
        return move(self, target)

    write_all(tmp_path, writers(OLD, "mask.png", "render.png"))
    monkeypatch.setattr(Path, "replace", interrupted)
    # A shell starts what runs in the background with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    with pytest.raises(KeyboardInterrupt):
        write_all(tmp_path, writers(NEW, "mask.png", "render.png"))
    assert contents(tmp_path) == dict.fromkeys((MARK, "mask.png", "render.png"), NEW)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_mark_comes_last(tmp_path, monkeypatch):
    """Should the machine stop between two moves, the folder is not taken for a whole result."""
    move = Path.replace

    def stop(self: Path, target: Path) -> Path:
        if self.name == "render.png":
            raise OSError(errno.EIO, "stopped")
        return move(self, target)

    write_all(tmp_path, writers(OLD, "mask.png", "render.png"))
    monkeypatch.setattr(Path, "replace", stop)
    with pytest.raises(OutputError):
        write_all(tmp_path, writers(NEW, "mask.png", "render.png"))
    assert MARK not in contents(tmp_path)
    # What it has left there is ours to replace.
    monkeypatch.setattr(Path, "replace", move)
    write_all(tmp_path, writers(NEW, "mask.png", "render.png"))
    assert contents(tmp_path) == dict.fromkeys((MARK, "mask.png", "render.png"), NEW)


def test_reserve_cleans_up_after_a_failed_run(tmp_path):
    """Preview and folders made for it go, a folder that was there stays."""
    (tmp_path / "there").mkdir()
    for folder in (tmp_path / "there", tmp_path / "made" / "deep"):
        with pytest.raises(KeyboardInterrupt), reserve(folder, {MARK}, 0) as preview:
            write_one(preview, b"png")
            assert [path.name for path in folder.iterdir()] == [preview.name]
            raise KeyboardInterrupt
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


def test_reserve_keeps_a_result(tmp_path):
    """After a good run the result is there and the preview is gone."""
    with reserve(tmp_path / "new", {MARK}, 0) as preview:
        write_one(preview, b"png")
        write_all(tmp_path / "new", writers(NEW))
    assert contents(tmp_path / "new") == {MARK: NEW}


def test_an_interrupted_run_that_can_go_on_keeps_its_preview(tmp_path):
    """It shows the state that the checkpoint holds; the next run ends with neither."""
    with pytest.raises(KeyboardInterrupt), reserve(tmp_path, {MARK}, 0) as preview:
        write_one(preview, b"png")
        write_one(tmp_path / CHECKPOINT, b"state")
        raise KeyboardInterrupt
    assert {path.name for path in tmp_path.iterdir()} == {preview.name, CHECKPOINT}
    with reserve(tmp_path, {MARK}, 0):
        (tmp_path / CHECKPOINT).unlink()
    assert list(tmp_path.iterdir()) == []


def test_reserve_refuses_before_the_work(tmp_path, monkeypatch):
    """No room, a file in the way, somebody else's files: said before minutes of computing."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "mask.png").write_text("mine")
    for name, reason in (
        ("file", "not a folder"),
        ("file/deep", "not a folder"),
        ("foreign", "holds mask.png"),
        ("n" * 300, "too long"),
    ):
        with pytest.raises(OutputError, match=reason), reserve(tmp_path / name, {"mask.png"}, 0):
            pytest.fail("reserved")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(9 << 30, 0, 7 << 20))
    with (
        pytest.raises(OutputError, match=r"7 MB are free on its disk, 101 MB are needed"),
        reserve(tmp_path / "full", set(), 100 << 20),
    ):
        pytest.fail("reserved")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "foreign"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_reserve_needs_permission(tmp_path):
    """A read-only folder is refused with its name."""
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    with pytest.raises(OutputError, match="locked: no permission"), reserve(folder, set(), 0):
        pytest.fail("reserved")


def test_reserve_removes_what_a_killed_run_left(tmp_path):
    """Only hidden folders of ours that are old: a young one may belong to a running process."""
    for name in (".unlit-old", ".unlit-young"):
        (tmp_path / name).mkdir()
    os.utime(tmp_path / ".unlit-old", (0, 0))
    with reserve(tmp_path, set(), 0):
        assert [path.name for path in tmp_path.iterdir()] == [".unlit-young"]


def test_write_one_is_whole_or_not(tmp_path):
    """The old file stays when the new one cannot be written."""
    path = tmp_path / "a.png"
    write_one(path, b"old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        with pytest.raises(OutputError, match=r"a\.png"):
            write_one(path, b"new" * 100)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"]


def _pictures(text: bytes) -> list[tuple[str, bytes]]:
    return [(f"{k}.png", text) for k in range(3)]


def test_several_files_replace_older_ones(tmp_path):
    write_several(tmp_path, _pictures(b"old")[:2])
    write_several(tmp_path, _pictures(b"new"))
    assert contents(tmp_path) == dict.fromkeys(("0.png", "1.png", "2.png"), "new")


def test_of_several_files_none_is_replaced_where_one_cannot_be(tmp_path):
    """A folder has the name of the second."""
    (tmp_path / "0.png").write_text("old")
    (tmp_path / "1.png").mkdir()
    with pytest.raises(OutputError, match=r"1\.png: a folder"):
        write_several(tmp_path, _pictures(b"new"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.png", "1.png"]
    assert (tmp_path / "0.png").read_text() == "old"


def test_several_files_are_put_back_when_a_move_fails(tmp_path, monkeypatch):
    """The last move is refused: the first comes back, the second, which is new, goes."""
    (tmp_path / "0.png").write_text("old")
    (tmp_path / "2.png").write_text("old")
    move = Path.replace

    def replace(self: Path, target: Path) -> Path:
        if target == tmp_path / "2.png" and self.read_bytes() == b"new":
            raise OSError(errno.EPERM, "no")
        return move(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(OutputError, match="no permission to write"):
        write_several(tmp_path, _pictures(b"new"))
    assert contents(tmp_path) == {"0.png": "old", "2.png": "old"}
