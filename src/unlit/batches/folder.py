"""The folder of a batch, on this machine or on any file system that fsspec knows.

    DIR/NAME/            a result, as `unlit reconstruct` writes it; NAME/face0 etc. of face="all"
    DIR/records/NAME.json  what is known of the photo (record.py)
    DIR/batch.csv, ...   the summary

Here a result is put in place by storage/folder.py. Elsewhere it is first written to a folder of
this machine, then copied; `MARK`, without which a folder is no result, is removed first and copied
last, and each file appears whole, which object stores promise.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fsspec.core import url_to_fs
from fsspec.implementations.local import LocalFileSystem

from ..errors import OutputError
from ..output.save import RESULT_FILES
from ..storage.folder import MARK, reserve, write_one
from .record import Record

#: Names in the batch's folder that no photo's result may have.
RECORDS = "records"
TABLES = ("batch.csv", "batch.html", "batch.parquet")
_RECORD_LIMIT = 1 << 20
#: In a result's folder of this machine while it is worked on.
_BEGUN = ".unlit-begun"


class BatchFolder:
    """The batch's folder `url`. What cannot be read or written raises OutputError.

    url: a path, made absolute, or a URL such as s3://bucket/folder, for which s3fs is needed.
    local: the folder as a path, None for other file systems.
    """

    def __init__(self, url: str) -> None:
        try:
            if "://" in url:
                self._fs, root = url_to_fs(url)
            else:  # a path may look like a chain of URLs ("a::b")
                self._fs, root = LocalFileSystem(), str(Path(url).absolute())
        except Exception as error:
            reason = " ".join(str(error).split())
            raise OutputError(f"{url}: cannot be used ({reason}); give a folder or URL") from error
        self._root = root.rstrip("/")
        self.local = Path(root) if isinstance(self._fs, LocalFileSystem) else None
        self.url = url if self.local is None else root
        if self.local is not None and self.local.exists() and not self.local.is_dir():
            raise OutputError(f"{url}: a file, not a folder; give a folder or URL to write to")

    def records(self) -> dict[str, Record]:
        """What is kept of each photo, by the name of its result."""
        with self._explained(RECORDS):
            try:
                entries = self._fs.ls(self._path(RECORDS), detail=True)
            except FileNotFoundError:
                return {}
            paths = [
                entry["name"]
                for entry in entries
                if entry["name"].endswith(".json") and (entry["size"] or 0) <= _RECORD_LIMIT
            ]
            # Unlike `cat` it takes brackets for what they are, and it asks for all at once.
            contents = self._fs.cat_ranges(
                paths, [0] * len(paths), [_RECORD_LIMIT] * len(paths), on_error="return"
            )
        found = {}
        for path, content in zip(paths, contents, strict=True):
            name = path.rpartition("/")[2].removesuffix(".json")
            record = Record.decode(content) if isinstance(content, bytes) else None
            if record is not None and not name.startswith("."):
                found[name] = record
        return found

    def record(self, name: str) -> Record | None:
        """What is kept of the photo whose result is called `name`."""
        place = f"{RECORDS}/{name}.json"
        with self._explained(place):
            try:
                content: Any = self._fs.cat_file(self._path(place), end=_RECORD_LIMIT)
            except FileNotFoundError:
                return None
        return Record.decode(content)

    def is_whole(self, place: str) -> bool:
        """Whether a result is there."""
        return self.holds(f"{place}/{MARK}")

    def holds(self, place: str) -> bool:
        """Whether a file is there."""
        with self._explained(place):
            return bool(self._fs.exists(self._path(place)))

    def write(self, place: str, content: bytes) -> None:
        """Write one file, in one step, to `place` below the folder."""
        with self._explained(place):
            self._fs.makedirs(self._path(place).rpartition("/")[0], exist_ok=True)
            if self.local is not None:
                write_one(self.local / place, content)
            else:
                self._fs.pipe_file(self._path(place), content)

    @contextlib.contextmanager
    def result(self, place: str, need: int) -> Iterator[Path]:
        """A folder of this machine to save a result in, which is in `place` on leaving.

        need: bytes that it will take; too little room here is told at once. What a killed process
        left of a result is removed, somebody else's files are refused.
        """
        if self.local is not None:
            folder = self.local / place
            with self._explained(place):
                _remove_remains(folder)
            with reserve(folder, RESULT_FILES, need):
                (folder / _BEGUN).touch()
                try:
                    yield folder
                finally:
                    (folder / _BEGUN).unlink(missing_ok=True)
            return
        with tempfile.TemporaryDirectory(prefix="unlit-") as name:
            folder = Path(name) / "result"
            with reserve(folder, RESULT_FILES, need):
                yield folder
            with self._explained(place):
                self._copy(folder, place)

    def _copy(self, folder: Path, place: str) -> None:
        mark = self._path(f"{place}/{MARK}")
        if self._fs.exists(mark):
            self._fs.rm_file(mark)
        self._fs.makedirs(self._path(place), exist_ok=True)
        for file in sorted(folder.iterdir(), key=lambda file: file.name == MARK):
            self._fs.put_file(str(file), self._path(f"{place}/{file.name}"))

    def link(self, place: str) -> str:
        """`place` as a path or URL for people."""
        return f"{self.url.rstrip('/')}/{place}"

    def _path(self, place: str) -> str:
        return f"{self._root}/{place}"

    @contextlib.contextmanager
    def _explained(self, place: str) -> Iterator[None]:
        """Turn what a file system refuses, by whatever error, into an OutputError of one line."""
        try:
            yield
        except OutputError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise OutputError(
                f"{self.link(place)}: cannot be read or written ({reason})"
            ) from error


def _remove_remains(folder: Path) -> None:
    """Remove what a process that was killed has left in `folder`; it left _BEGUN, too."""
    if (folder / _BEGUN).exists():
        if not (folder / MARK).exists():
            for name in RESULT_FILES:
                (folder / name).unlink(missing_ok=True)
        for staging in folder.glob(".unlit-*/"):
            shutil.rmtree(staging, ignore_errors=True)
