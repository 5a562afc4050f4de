"""The folder of a batch on this machine and elsewhere: whole results, or none."""

from pathlib import Path

import fsspec
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from unlit.batches.folder import RECORDS, BatchFolder
from unlit.batches.record import BatchRow, Record
from unlit.errors import OutputError
from unlit.storage.folder import MARK, MARK_TEXT


class Unreliable(MemoryFileSystem):
    """A remote store whose connection fails once so many files have been put."""

    protocol = "unreliable"
    store, pseudo_dirs = {}, [""]
    left = 10**6

    def put_file(self, *args, **kwargs):
        type(self).left -= 1
        if self.left < 0:
            raise ConnectionError("connection reset\nby peer")
        return super().put_file(*args, **kwargs)


fsspec.register_implementation("unreliable", Unreliable, clobber=True)


@pytest.fixture(params=["local", "file", "memory"])
def url(request, tmp_path) -> str:
    MemoryFileSystem.store.clear()
    kinds = {
        "local": f"{tmp_path}/a::b [1]",
        "file": f"file://{tmp_path}/x",
        "memory": "memory://x",
    }
    return kinds[request.param]


def fill(folder: Path, text: str) -> None:
    (folder / "a.txt").write_text(text)
    (folder / MARK).write_text(MARK_TEXT + text)


def put(store: BatchFolder, place: str, text: str) -> None:
    with store.result(place, 1000) as folder:
        folder.mkdir(exist_ok=True)
        fill(folder, text)


def test_a_result_is_put_and_found(url):
    """With a folder in a folder, as for all faces of a photo; replaced by the next."""
    store = BatchFolder(url)
    assert not store.is_whole("x/face0")
    put(store, "x/face0", "one")
    put(store, "x/face0", "two")
    again = BatchFolder(store.url)
    assert again.is_whole("x/face0")
    fs, root = fsspec.filesystem("memory" if "memory" in url else "file"), store.url
    root = root.removeprefix("memory:/")
    assert fs.cat_file(f"{root}/x/face0/a.txt") == b"two"


def test_records_are_found_by_name(url):
    """Written in one step, read singly and together; damaged and hidden files count as none."""
    store = BatchFolder(url)
    assert store.records() == {}
    assert store.record("a") is None
    record = Record("/p/a.jpg", None, [BatchRow("/p/a.jpg", "a")])
    store.write(f"{RECORDS}/a.json", record.encode())
    store.write(f"{RECORDS}/b.json", b"{")
    store.write(f"{RECORDS}/..json", record.encode())
    store.write(f"{RECORDS}/big.json", record.encode() + b" " * (1 << 20))
    assert store.records() == {"a": record}
    assert store.record("a") == record
    assert store.record("b") is None


def test_what_a_killed_process_left_is_removed(tmp_path):
    """Killed while files were moved into place: no mark, half of the files, the staged rest."""
    store = BatchFolder(str(tmp_path))
    with store.result("a", 1000) as folder:
        marker = [path.name for path in folder.iterdir()]
        fill(folder, "old")
    (tmp_path / "a" / MARK).unlink()
    (tmp_path / "a" / "montage.png").write_text("old")
    (tmp_path / "a" / "notes").write_text("mine")
    (tmp_path / "a" / ".unlit-x1y2").mkdir()
    with pytest.raises(OutputError, match="holds montage"), store.result("a", 1000):
        pass
    (tmp_path / "a" / marker[0]).touch()
    put(store, "a", "new")
    assert {path.name for path in (tmp_path / "a").iterdir()} == {MARK, "a.txt", "notes"}


def test_a_broken_connection_leaves_no_result(monkeypatch):
    """After any number of files the result is not whole, even where an older one was."""
    store = BatchFolder("unreliable://x")
    put(store, "a", "old")
    for files in (0, 1):
        monkeypatch.setattr(Unreliable, "left", files)
        with pytest.raises(OutputError, match=r"unreliable://x/a.*connection reset by peer"):
            put(store, "a", "new")
        assert not store.is_whole("a")
        monkeypatch.setattr(Unreliable, "left", 10)
        put(store, "a", "old")
        assert store.is_whole("a")


@pytest.mark.parametrize("url", ["nosuch://x", "s3://x"])
def test_urls_that_cannot_be_used(url):
    """One line that names the URL."""
    with pytest.raises(OutputError) as error:
        BatchFolder(url).records()
    assert url in str(error.value)
    assert "\n" not in str(error.value)


def test_a_folder_that_cannot_be_written(tmp_path):
    """A file in the place of the folder."""
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        BatchFolder(str(tmp_path / "file")).write("batch.csv", b"")


def test_a_file_is_no_folder(tmp_path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="a file, not a folder"):
        BatchFolder(str(tmp_path / "notes.txt"))
