"""LLVM is found wherever pip put it, kernels are kept where they can be, one core is enough."""

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

from unlit.machine import runtime

SCRIPT = """
import sys, unlit, drjit, numpy
from pathlib import Path
from unlit.machine.runtime import mitsuba
mitsuba()
drjit.set_thread_count(1)
from unlit.output.images import exr
from unlit.storage.pictures import read_picture
image = numpy.random.default_rng(0).random((200, 200, 3)).astype("f4")
path = Path(sys.argv[1])
path.write_bytes(exr(image))
assert (read_picture(path) == image).all()
assert drjit.thread_count() == 1
"""


def test_pictures_are_written_and_read_with_one_thread(tmp_path):
    """Mitsuba's OpenEXR hangs without a second thread, as on one core; so in a process."""
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "x.exr")]
    subprocess.run(command, check=True, timeout=120)


def installed(site: Path, library: Path) -> None:
    """What pip leaves of LLVM's wheel: its list of files in `site`, which may lead out of it."""
    library.parent.mkdir(parents=True)
    library.touch()
    library.with_name("libLLVM.so").symlink_to(library.name)
    info = site / "karellen_llvm_core-23.1.4.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: karellen-llvm-core\nVersion: 23.1.4\n"
    )
    up = Path(*[".."] * len(site.relative_to(library.parents[1]).parts), "lib")
    names = (library.name, "libLLVM.so", "libLLVM-gone.so", "other.so")
    (info / "RECORD").write_text("".join(f"{up / name},,\n" for name in names))


@pytest.mark.parametrize(
    ("site", "library"),
    [
        ("venv/lib/python3.12/site-packages", "venv/lib"),
        ("home/.local/lib/python3.11/site-packages", "home/.local/lib"),
        ("usr/local/lib/python3.11/dist-packages", "usr/local/lib"),
        ("target", "target/lib"),
    ],
    ids=["venv", "user", "debian-root", "target"],
)
def test_llvm_is_where_the_wheel_says(site, library, tmp_path, monkeypatch):
    """And nowhere else: an older one in the system's folders is not looked at."""
    place = tmp_path / library / "libLLVM.so.23.1"
    installed(tmp_path / site, place)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(sys, "path", [str(tmp_path / site)])
    importlib.invalidate_caches()
    assert runtime.llvm_library() == place
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/my/libLLVM.so")
    assert runtime.llvm_library() == Path("/my/libLLVM.so")


def test_without_the_wheel_the_search_is_drjit_s(tmp_path, monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert runtime.llvm_library() is None


def test_kernels_are_kept_where_they_can_be(tmp_path, monkeypatch):
    """In the home; else in the cache folder that is named; else nowhere."""
    home, cache, chosen = (tmp_path / name for name in ("home", "cache", "chosen"))
    home.mkdir()
    denied: set[Path] = set()
    monkeypatch.setattr(runtime.os, "access", lambda place, _: Path(place) not in denied)
    monkeypatch.delenv("DRJIT_CACHE_DIR", raising=False)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    assert runtime.kernel_cache() == home / ".drjit"
    denied.add(home)
    assert runtime.kernel_cache() == cache / "unlit" / "kernels"
    denied.add(tmp_path)
    assert runtime.kernel_cache() is None
    denied.clear()
    monkeypatch.setenv("DRJIT_CACHE_DIR", str(chosen))
    assert runtime.kernel_cache() == chosen
    monkeypatch.delenv("DRJIT_CACHE_DIR")
    monkeypatch.delenv("HOME")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert runtime.kernel_cache() is None
