"""doctor.py: says what is there, and names the remedy for what is not."""

import os
import platform
import re
import subprocess
import sys
import tomllib
from collections import namedtuple
from pathlib import Path

import pytest

from unlit.machine import assets, doctor


def by_name(found):
    return {check.name: check for check in found}


def test_this_machine(monkeypatch, tmp_path, capfd):
    """The suite runs here, so the renderer must be found sound; missing models must be told.

    Nothing may be printed: the command line does that.
    """
    monkeypatch.delenv(assets.FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(assets, "cache_folder", lambda: tmp_path / "not" / "yet")
    found = by_name(doctor.checks())
    for name in ("python", "system", "renderer", "back end", "disk", "cores"):
        assert found[name].ok, found[name]
    assert platform.python_version() in found["python"].detail
    assert "LLVM" in found["back end"].detail or "CUDA" in found["back end"].detail
    for name in ("face_landmarker.task", "makehuman-head"):
        check = found[f"model {name}"]
        assert not check.ok
        assert "unlit models" in check.remedy
        assert str(tmp_path) in check.remedy
    assert capfd.readouterr() == ("", "")
    assert all("\n" not in check.detail + check.remedy for check in found.values())


def test_an_llvm_that_aborts_the_process_is_reported(monkeypatch):
    """Debian's libllvm15 aborts; the doctor must live to tell which library did it."""
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/somewhere/libLLVM-15.so")
    monkeypatch.setattr(
        doctor,
        "_PROBE",
        "import os, sys;"
        "sys.stderr.write('LLVM ERROR: Cannot select: fminimum\\nIn function: f\\n');"
        "sys.stderr.flush(); os.abort()",
    )
    (check,) = doctor._renderer()
    assert not check.ok
    assert "/somewhere/libLLVM-15.so" in check.detail
    if sys.platform != "win32":
        assert "Cannot select" in check.detail
    assert "DRJIT_LIBLLVM_PATH" in check.remedy


def test_no_llvm_at_all(monkeypatch):
    """The runtime's own error is split into what is wrong and what to do."""
    monkeypatch.setattr(
        doctor,
        "_PROBE",
        "from unlit.errors import MachineError; raise MachineError('no LLVM: install one')",
    )
    (check,) = doctor._renderer()
    assert not check.ok
    assert check.detail.startswith("no LLVM")
    assert check.remedy == "install one"


def test_missing_package(monkeypatch):
    """A broken installation is not blamed on LLVM."""
    monkeypatch.setattr(doctor, "_PROBE", "import no_such_package_at_all")
    (check,) = doctor._renderer()
    assert not check.ok
    assert "no_such_package_at_all" in check.detail
    assert "pip install" in check.remedy


def test_a_probe_that_hangs(monkeypatch):
    """A driver that never answers must not hang the doctor."""

    def hang(*args, **kwargs):
        raise subprocess.TimeoutExpired("probe", kwargs["timeout"])

    monkeypatch.setattr(doctor.subprocess, "run", hang)
    (check,) = doctor._renderer()
    assert not check.ok
    assert "no answer" in check.detail


def test_models_found_and_folder_misnamed(monkeypatch, tmp_path):
    """A verified model has no remedy; a UNLIT_MODELS that does not exist is one failed check."""
    entry = assets.ASSETS["face_landmarker.task"]
    found = [assets.AssetStatus(entry, tmp_path / entry.file, None)]
    monkeypatch.setattr(assets, "statuses", lambda: found)
    (check,) = doctor._models()
    assert check.ok
    assert str(tmp_path) in check.detail
    assert check.remedy == ""
    monkeypatch.undo()
    monkeypatch.setenv(assets.FOLDER_VARIABLE, str(tmp_path / "nowhere"))
    (check,) = doctor.looked("models", doctor._models)
    assert not check.ok
    assert "nowhere" in check.detail


def test_a_check_that_fails_does_not_end_the_others(monkeypatch):
    """Whatever a check meets is a finding of one line."""

    def trip(*_, **__):
        raise OSError(13, "no\npermission")

    monkeypatch.setattr(doctor.subprocess, "run", trip)
    monkeypatch.setattr(doctor.shutil, "disk_usage", trip)
    monkeypatch.setattr(doctor, "cores", trip)
    monkeypatch.setattr(doctor.importlib.util, "find_spec", trip)
    monkeypatch.setattr(doctor, "_free_memory", trip)
    found = by_name(doctor.checks())
    assert found["python"].ok
    for name in ("renderer", "memory", "disk", "cores", "extras"):
        check = found[name]
        assert not check.ok
        assert check.remedy
        assert "PermissionError" in check.detail
        assert "\n" not in check.detail


def test_extras_are_those_of_the_package(monkeypatch):
    """Installed ones are told, missing ones with what installs them; they are no failures."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    assert doctor.EXTRAS.keys() == extras.keys() - {"test", "dev", "docs"}
    for name, (modules, _) in doctor.EXTRAS.items():
        assert len(modules) == len(extras[name])
    monkeypatch.setattr(
        doctor.importlib.util, "find_spec", lambda name: None if name == "av" else "found"
    )
    found = by_name(doctor._extras())
    assert "pip install 'unlit[video]'" in found["extra video"].remedy
    assert found["extra batch"].remedy == ""
    assert all(check.ok for check in found.values())


@pytest.mark.parametrize(("free", "ok"), [(None, True), (1 << 30, False), (8 << 30, True)])
def test_memory(monkeypatch, free, ok):
    """Too little memory is a finding with a remedy; unknown memory is not a failure."""
    monkeypatch.setattr(doctor, "_free_memory", lambda: free)
    check = doctor._memory()
    assert check.ok is ok
    assert bool(check.remedy) is not ok


def test_full_disk(monkeypatch):
    """The models must fit into the cache."""
    usage = namedtuple("usage", "total used free")(1 << 40, 1 << 40, 1 << 20)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda place: usage)
    check = doctor._disk()
    assert not check.ok
    assert "free" in check.remedy


def test_old_python(monkeypatch):
    """An unsupported Python is named with those that are supported."""
    monkeypatch.setattr(doctor.sys, "version_info", (3, 9, 1))
    check = doctor._python()
    assert not check.ok
    assert "3.11" in check.remedy


def test_a_library_that_crashes_is_reported_and_the_others_are_tried(monkeypatch):
    """By name, with what reinstalls it; one that raises likewise."""
    libraries = {
        "json": ("first", "json.dumps(1)"),
        "os": ("crashes", "os.abort()"),
        "csv": ("raises", "raise OSError('libx.so: cannot open')"),
        "math": ("last", "math.sqrt(2)"),
    }
    monkeypatch.setattr(doctor, "_LIBRARIES", libraries)
    found = by_name(doctor._libraries())
    assert found.keys() == {"library os", "library csv"}
    assert "ends the process (signal 6)" in found["library os"].detail
    assert "OSError: libx.so: cannot open" in found["library csv"].detail
    assert "--force-reinstall crashes" in found["library os"].remedy
    del libraries["os"], libraries["csv"]
    (check,) = doctor._libraries()
    assert check.ok and check.detail == "json, math"


def test_every_dependency_is_tried():
    """Those of the renderer have a probe of their own; pip is only called."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    names = {re.split("[>;]", text)[0] for text in project["project"]["dependencies"]}
    tried = {package for package, _ in doctor._LIBRARIES.values()}
    assert names - tried == {"mitsuba", "karellen-llvm-core", "pip"}


@pytest.mark.parametrize(
    ("module", "error"),
    [
        ("msgspec", "ImportError"),
        ("msgspec", "RuntimeError"),
        ("platformdirs", "ImportError"),
        ("platformdirs", "AttributeError"),
    ],
)
@pytest.mark.parametrize("command", ["doctor", "montage"])
def test_a_broken_package_is_a_line_and_no_traceback(module, error, command, tmp_path):
    """Whatever it raises: the doctor names it, the other commands name the doctor."""
    (tmp_path / f"{module}.py").write_text(f"raise {error}('libbroken.so: cannot open')")
    path = os.pathsep.join([str(tmp_path), str(Path(doctor.__file__).parents[2])])
    arguments = [command] if command == "doctor" else [command, str(tmp_path / "absent")]
    ran = subprocess.run(
        [sys.executable, "-m", "unlit", *arguments],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 1
    assert "Traceback" not in ran.stderr
    if command == "doctor":
        assert re.search(f"BAD +library {module} .*libbroken", ran.stdout)
    else:
        assert ran.stderr.count("\n") == 1 and ran.stderr.startswith("unlit: error: ")


def test_kernels_that_cannot_be_kept_are_no_failure(monkeypatch):
    monkeypatch.setattr(doctor, "kernel_cache", lambda: None)
    check = doctor._kernels()
    assert check.ok and "DRJIT_CACHE_DIR" in check.remedy
