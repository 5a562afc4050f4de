"""user_folders.py: a user without a name and without a home is told what to set."""

from pathlib import Path

import platformdirs
import pytest

from unlit import cli
from unlit.errors import MachineError
from unlit.head import files
from unlit.machine import assets, user_folders


def raise_(*_, **__):
    raise RuntimeError("could not determine the home directory")


@pytest.fixture(params=[raise_, lambda *_, **__: Path("~/.cache/unlit")])
def homeless(request, monkeypatch):
    """As platformdirs answers where there is neither HOME nor a name: it raises or passes "~"."""
    monkeypatch.delenv(assets.FOLDER_VARIABLE, raising=False)
    for name in ("user_cache_path", "user_data_path"):
        monkeypatch.setattr(platformdirs, name, request.param)


@pytest.mark.parametrize("folder", [user_folders.user_cache, user_folders.user_data])
def test_no_home(homeless, folder):
    """One line, with the variables."""
    with pytest.raises(MachineError, match="set HOME, or both XDG_CACHE_HOME and XDG_DATA_HOME"):
        folder()


@pytest.mark.parametrize("line", ["models", "models fetch", "models verify"])
def test_commands_without_a_home(homeless, capsys, line):
    """No traceback."""
    assert cli.main(line.split()) == 1
    error = capsys.readouterr().err
    assert error.startswith("unlit: error: the user's home folder is not known: set HOME")
    assert error.count("\n") == 1


def test_reconstruct_without_a_home(homeless, capsys, tmp_path):
    """Before anything is computed."""
    from PIL import Image

    Image.new("RGB", (80, 80)).save(tmp_path / "a.png")
    arguments = ["reconstruct", str(tmp_path / "a.png"), "-o", str(tmp_path / "out")]
    assert cli.main(arguments) == 1
    assert "set HOME" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_doctor_without_a_home(homeless, capsys, monkeypatch):
    """It goes on with the other checks."""
    from unlit.machine import doctor

    monkeypatch.setattr(doctor, "_renderer", list)
    assert cli.main(["doctor"]) == 1
    said = capsys.readouterr().out
    assert "BAD  models" in said
    assert "-> set HOME" in said
    assert "cores" in said


def test_models_in_a_folder_of_their_own_need_no_home(homeless, monkeypatch, tmp_path):
    """UNLIT_MODELS is looked into first."""
    entry = assets.ASSETS["face_landmarker.task"]
    (tmp_path / entry.file).write_bytes(b"x")
    monkeypatch.setattr(assets, "_problem", lambda entry, path: None)
    monkeypatch.setenv(assets.FOLDER_VARIABLE, str(tmp_path))
    assert assets.asset(entry.name) == tmp_path / entry.file


def test_folders_with_a_home(monkeypatch, tmp_path):
    """As platformdirs has them."""
    monkeypatch.setattr(platformdirs, "user_data_path", lambda *_, **__: tmp_path / "unlit")
    assert files.models_folder() == tmp_path / "unlit" / "heads"


def test_a_home_in_a_name(monkeypatch, tmp_path):
    """And a name that is left as it is where there is none."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert user_folders.expanded("~/x") == tmp_path / "x"
    assert user_folders.expanded("a~/x") == Path("a~/x")
