"""Put a set of files into a folder so that nobody ever sees half of it.

All files are first written into a hidden folder inside the target, then moved into place. The
moves take no room and about a millisecond, and signals wait until they are done. `MARK`, the file
without which a folder is no result, is removed first and moved last: should the machine stop in
between, the folder says that it is not whole, and by a hidden file that what is there is ours.
Staging inside the target, not beside it, also works where the target is a mounted volume or the
current folder, or its parent is read-only.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from pathlib import Path

from ..errors import OutputError

#: The file that makes a folder a result, and the words it starts with.
MARK = "reconstruction.toml"
MARK_TEXT = "# unlit reconstruction"
#: What a running reconstruction shows of itself, in the target folder.
PREVIEW = "unlit-preview.png"
#: The page that shows a result, the stages' pictures on it, and the picture that stands for a
#: result on a batch's page; a result can do without.
REPORT, STAGES, THUMBNAIL = "report.html", "stages.zip", "thumbnail.webp"
#: What it can be resumed from, removed when the result is in place.
CHECKPOINT = ".unlit-checkpoint.npz"

_STAGING = ".unlit-"
_MOVING = ".unlit-moving"
_STALE_SECONDS = 3600
_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some room and try again",
    errno.EDQUOT: "your disk quota is used up; free some room and try again",
    errno.EFBIG: "the system refuses a file of this size; raise the limit (ulimit -f)",
    errno.EACCES: "no permission to write; choose another folder or change its access rights",
    errno.EPERM: "no permission to write; choose another folder or change its access rights",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.ENOTDIR: "not a folder; choose another name",
    errno.EEXIST: "not a folder; choose another name",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}


@contextlib.contextmanager
def reserve(folder: Path, names: Collection[str], need: int) -> Generator[Path]:
    """Make sure, before minutes of work, that a result can be written; leave no trace of a failure.

    folder: the target, made if need be. names: the files to come. need: bytes that must be free.
    Yields the path for previews. On leaving, the preview is removed, unless there is a checkpoint,
    whose state it shows, and so are the folders made here that are still empty. Raises OutputError.
    """
    with _made(folder):
        with _explained(folder):
            _refuse_foreign(folder, names)
            _remove_stale(folder)
            _staging(folder).cleanup()
            free = shutil.disk_usage(folder).free
        if free < need:
            raise OutputError(
                f"{folder}: {free >> 20} MB are free on its disk, {(need >> 20) + 1} MB are "
                "needed; free some, or choose another folder"
            )
        try:
            yield folder / PREVIEW
        finally:
            with contextlib.suppress(OSError):
                if not (folder / CHECKPOINT).exists():
                    (folder / PREVIEW).unlink(missing_ok=True)


def write_all(
    folder: Path,
    writers: Mapping[str, Callable[[Path], object]],
    mark: str = MARK,
    mark_text: str = MARK_TEXT,
    obsolete: Collection[str] = (),
) -> None:
    """Write files into `folder`: all of them, or none.

    writers: by file name, a function that writes the file to the path it is given; `mark`, which
    starts with `mark_text`, is one of them. obsolete: names of files to remove in the same step,
    if they are ours. Files of other names stay as they are. Raises OutputError.
    """
    with _made(folder), _explained(folder):
        _refuse_foreign(folder, writers, mark, mark_text)
        with _staging(folder) as name:
            staging = Path(name)
            for file, write in writers.items():
                write(staging / file)
            with _signals_wait():
                old = set(obsolete) - writers.keys() if _is_ours(folder, mark, mark_text) else ()
                (folder / _MOVING).touch()
                (folder / mark).unlink(missing_ok=True)
                for file in old:
                    if (folder / file).is_file():
                        (folder / file).unlink()
                for file in sorted(writers, key=lambda file: file == mark):
                    (staging / file).replace(folder / file)
                (folder / _MOVING).unlink()


def ensure_writable(*paths: Path) -> None:
    """Make sure, before minutes of work: files `paths` can be written. Raises OutputError."""
    for folder in dict.fromkeys(path.parent for path in paths):
        if not folder.is_dir():
            raise OutputError(f"{folder}: no such folder; make it, or choose another")
        with _explained(folder):
            _staging(folder).cleanup()
    _refuse_folders(paths)


def _refuse_folders(paths: Iterable[Path]) -> None:
    for path in paths:
        if path.is_dir():
            raise OutputError(f"{path}: a folder; give the name of a file")


def write_one(path: Path, content: bytes) -> None:
    """Write one file in one step. Raises OutputError."""
    with _explained(path), _staging(path.parent) as name:
        staged = Path(name) / path.name
        staged.write_bytes(content)
        staged.replace(path)


def write_several(folder: Path, contents: Iterable[tuple[str, bytes]]) -> None:
    """Write files of given names into `folder`: all of them, in one step, or none.

    contents: taken one after the other. Files of those names are replaced. Raises OutputError.
    """
    with _explained(folder), _staging(folder) as name:
        names: list[str] = []
        for file, content in contents:
            (Path(name) / file).write_bytes(content)
            names.append(file)
        aside = Path(tempfile.mkdtemp(dir=name))
        with _signals_wait():
            _refuse_folders(folder / file for file in names)
            _replace(Path(name), folder, names, aside)


def _replace(staging: Path, folder: Path, names: Iterable[str], aside: Path) -> None:
    """Move files of those names into `folder`; what they replace is put back if one fails."""
    moved: list[str] = []
    kept: list[str] = []
    try:
        for file in names:
            if os.path.lexists(folder / file):
                (folder / file).replace(aside / file)
                kept.append(file)
            (staging / file).replace(folder / file)
            moved.append(file)
    except BaseException:
        for file in moved:
            (folder / file).unlink(missing_ok=True)
        for file in kept:
            (aside / file).replace(folder / file)
        raise


def _staging(folder: Path) -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix=_STAGING, dir=folder, ignore_cleanup_errors=True)


@contextlib.contextmanager
def _made(folder: Path) -> Generator[None]:
    """Make the folder and its parents; remove again those made that are empty at the end."""
    made: list[Path] = []
    try:
        with _explained(folder):
            missing = [place for place in (folder, *folder.parents) if not place.exists()]
            for place in reversed(missing):
                place.mkdir(exist_ok=True)
                made.append(place)
            if not folder.is_dir():
                raise OutputError(f"{folder}: {_REMEDIES[errno.ENOTDIR]}")
        yield
    finally:
        for place in reversed(made):
            with contextlib.suppress(OSError):
                place.rmdir()


def _refuse_foreign(
    folder: Path, names: Collection[str], mark: str = MARK, mark_text: str = MARK_TEXT
) -> None:
    """A file of ours is replaced without asking, somebody else's of the same name is not."""
    if _is_ours(folder, mark, mark_text):
        return
    kind = "result" if mark == MARK else "export"
    for name in sorted(names):
        if (folder / name).exists():
            raise OutputError(
                f"{folder}: holds {name}, but is not a whole {kind} of unlit; choose another "
                f"folder or move {name} away"
            )


def _is_ours(folder: Path, mark: str, mark_text: str) -> bool:
    """Whether what lies in `folder` was written by us: a whole set of files, or one cut off."""
    if (folder / _MOVING).exists():
        return True
    try:
        with (folder / mark).open("rb") as file:
            return file.read(len(mark_text)) == mark_text.encode()
    except FileNotFoundError:
        return False


def _remove_stale(folder: Path) -> None:
    """Remove what a killed process left behind, but nothing a running one may still use."""
    for place in folder.glob(_STAGING + "*"):
        with contextlib.suppress(OSError):
            if place.is_dir() and time.time() - place.stat().st_mtime > _STALE_SECONDS:
                shutil.rmtree(place, ignore_errors=True)


@contextlib.contextmanager
def _explained(place: Path) -> Generator[None]:
    """Turn what the system refuses into an OutputError of one line."""
    try:
        yield
    except OSError as error:
        reason = _REMEDIES.get(error.errno or 0, f"cannot be written ({error.strerror or error})")
        raise OutputError(f"{place}: {reason}") from error


@contextlib.contextmanager
def _signals_wait() -> Generator[None]:
    """Hold back Ctrl-C and a request to end until the block is done.

    Handlers run in the main thread only, so that in any other there is nothing to hold back.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: arrived.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if arrived:
        signal.raise_signal(arrived[0])
