"""Model files: where they are looked for, and a verified copy of each on this machine.

`asset(name)` returns the path of a file of the manifest. It is looked for in the folder named by
the environment variable UNLIT_MODELS, then in the user's cache, and fetched into the cache only
if it is in neither. Nothing is used before its size and sha256 have been checked.

Two processes may fetch the same file at once without a lock: each writes into a temporary folder
of its own inside the cache and moves the verified file into place in one step.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from ..errors import ModelError
from ..progress.callbacks import silent
from .manifest import ASSETS, Asset
from .sources import FetchProgress, SourceError, fetched
from .user_folders import expanded, user_cache

FOLDER_VARIABLE = "UNLIT_MODELS"

_STALE_SECONDS = 24 * 3600
_TEMPORARY_PREFIX = ".fetch-"


@dataclass(frozen=True)
class AssetStatus:
    """Where an asset stands on this machine.

    path: the file found, or None.
    problem: None if the file is there and verified, else one line that says what is wrong.
    """

    asset: Asset
    path: Path | None
    problem: str | None


def cache_folder() -> Path:
    """The user's cache folder of model files; it need not exist yet. Raises MachineError."""
    return user_cache() / "models"


def asset(name: str, progress: FetchProgress = silent) -> Path:
    """Path of the verified file of asset `name`, which is fetched first if need be.

    A damaged file in the cache is fetched anew; one in the user's own folder is an error, because
    that folder is not ours to write to. progress: called with (asset, bytes so far, bytes in
    total); the last call has both equal. Raises ModelError.
    """
    if name not in ASSETS:
        raise ModelError(f"{name}: no such model; there are {', '.join(sorted(ASSETS))}")
    entry = ASSETS[name]
    status = _look_up(entry)
    if status.path is not None and status.problem is None:
        return status.path
    if status.path is not None and status.path.parent != cache_folder():
        raise ModelError(f"{status.problem}; replace or remove it, or unset {FOLDER_VARIABLE}")
    return _fetch(entry, progress)


def statuses() -> list[AssetStatus]:
    """Where every asset of the manifest stands on this machine; verifies, fetches nothing."""
    return [_look_up(entry) for entry in ASSETS.values()]


def _user_folder() -> Path | None:
    named = os.environ.get(FOLDER_VARIABLE)
    if not named:
        return None
    folder = expanded(named)
    if not folder.is_dir():
        raise ModelError(f"{FOLDER_VARIABLE}={named} is not a folder: create it or unset it")
    return folder


def _look_up(entry: Asset) -> AssetStatus:
    for place in (_user_folder, cache_folder):  # of which the second may not be known
        folder = place()
        if folder is not None and (path := folder / entry.file).exists():
            return AssetStatus(entry, path, _problem(entry, path))
    return AssetStatus(entry, None, f"{entry.file} is not on this machine yet")


def _problem(entry: Asset, path: Path) -> str | None:
    """What keeps the file at `path` from being the asset, or None."""
    try:
        if not path.is_file():
            return f"{path} is not a file"
        stat = path.stat()
        if stat.st_size != entry.size:
            return f"{path} has {stat.st_size} bytes, not the {entry.size} of {entry.name}"
        found = _sha256(path, stat.st_size, stat.st_mtime_ns)
    except OSError as error:
        return f"{path} cannot be read ({error.strerror})"
    if found != entry.sha256:
        return f"{path} has sha256 {found[:12]}, not the {entry.sha256[:12]} of {entry.name}"
    return None


@functools.lru_cache(maxsize=16)
def _sha256(path: Path, size: int, mtime_ns: int) -> str:
    """Hash of the file; size and time are there so that a changed file is hashed again."""
    del size, mtime_ns
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _fetch(entry: Asset, progress: FetchProgress) -> Path:
    cache = cache_folder()
    reasons: list[str] = []
    try:
        cache.mkdir(parents=True, exist_ok=True)
        _remove_stale(cache)
        for source in entry.sources:
            # A folder for each try, removed whatever happens, a Ctrl-C included.
            with tempfile.TemporaryDirectory(prefix=_TEMPORARY_PREFIX, dir=cache) as folder:
                try:
                    path = fetched(source, entry, Path(folder), progress)
                except SourceError as error:
                    reasons.append(f"{source}: {error}")
                    continue
                problem = _problem(entry, path)
                if problem is None:
                    return _place(entry, path, cache / entry.file)
                reasons.append(f"{source}: {problem.replace(str(path), 'what came')}")
    except OSError as error:
        raise ModelError(
            f"{entry.file} cannot be stored in {cache} ({error.strerror or error}): make room "
            f"and writable, or put the file (sha256 {entry.sha256[:12]}) into a folder and "
            f"name that in {FOLDER_VARIABLE}"
        ) from error
    raise ModelError(
        f"{entry.file} (sha256 {entry.sha256[:12]}) could not be fetched: {'; '.join(reasons)}. "
        f"Without a network, copy the file of that name from the cache of a machine that has it "
        f"into {cache}, or into a folder named in {FOLDER_VARIABLE}"
    )


def _place(entry: Asset, fetched: Path, place: Path) -> Path:
    # pip's files are closed to all but their owner; the cache is as open as its folder.
    fetched.chmod(0o666 & (place.parent.stat().st_mode | 0o600))
    try:
        fetched.replace(place)
    except PermissionError:
        # Windows refuses to replace a file that another process has open: it was faster.
        if _problem(entry, place) is not None:
            raise
    return place


def _remove_stale(cache: Path) -> None:
    """Remove what a killed process left behind, but nothing a running one may still use."""
    for folder in cache.glob(_TEMPORARY_PREFIX + "*"):
        with contextlib.suppress(OSError):  # another process removed it first
            if time.time() - folder.stat().st_mtime > _STALE_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)
