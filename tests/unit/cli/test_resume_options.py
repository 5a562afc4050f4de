"""`unlit reconstruct`: what --resume, --from-stage and --mask mean together."""

import json
import sys
import types
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import unlit.pipeline
from unlit import cli
from unlit.face.reconstruction import Metrics
from unlit.optimize import checkpoint
from unlit.settings.settings import PRESETS, override
from unlit.storage.folder import CHECKPOINT, MARK, MARK_TEXT
from unlit.storage.identity import Identity


@pytest.fixture
def calls(monkeypatch) -> list:
    """What the pipeline and the continuation are asked for, and by which options."""
    asked = []

    def stand_in(name: str):
        def run(*arguments, **options):
            asked.append((name, arguments, options))
            return types.SimpleNamespace(
                head=types.SimpleNamespace(landmark_residual=0.02),
                photo=types.SimpleNamespace(white_luminance=None),
                metrics=Metrics({}, {}, 700.0, ("dark",)),
            )

        return run

    for module, function in (("chain", "reconstruct"), ("resume", "resume")):
        fake: Any = types.ModuleType(f"unlit.pipeline.{module}")
        setattr(fake, function, stand_in(function))
        fake.check_resumable = lambda *_: None
        monkeypatch.setitem(sys.modules, fake.__name__, fake)
        monkeypatch.setattr(unlit.pipeline, module, fake, raising=False)
    settings = override(PRESETS["paper"], {"resolution": 300, "stage5.iterations": 7})
    face = types.SimpleNamespace(settings=settings, photo=types.SimpleNamespace(name="old.jpg"))
    monkeypatch.setattr("unlit.output.load.load", lambda folder: face)
    monkeypatch.setattr(
        "unlit.output.edits.edited", lambda face, folder, stage: (face, ["mask.png"])
    )
    monkeypatch.setattr("unlit.output.save.save", lambda *_: None)
    monkeypatch.setattr(cli.models, "fetch", lambda *_: None)
    return asked


@pytest.fixture
def photo(tmp_path) -> str:
    Image.fromarray(np.full((80, 90, 3), 128, np.uint8)).save(tmp_path / "a.png")
    return str(tmp_path / "a.png")


@pytest.mark.parametrize(
    "arguments",
    [
        ("PHOTO", "-o", "DIR", "--resume"),
        ("--resume", "PHOTO", "-o", "DIR"),
        ("PHOTO", "--resume", "DIR"),
        ("PHOTO", "--resume", "DIR", "-o", "DIR"),
    ],
)
def test_ways_to_write_resume(photo, calls, tmp_path, capsys, arguments):
    """All go on with what is in the folder; without a checkpoint they start, and say so."""
    folder = tmp_path / "out"
    folder.mkdir()
    given = [{"PHOTO": photo, "DIR": str(folder)}.get(word, word) for word in arguments]
    assert cli.main(["reconstruct", *given]) == 0
    ((name, (read,), options),) = calls
    assert (name, read.source) == ("reconstruct", "a.png")
    assert options["checkpoint"].path == folder / CHECKPOINT
    assert options["settings"].resolution == 512
    assert "nothing to resume" in capsys.readouterr().err


def test_resume_finds_its_photo(photo, calls, tmp_path, monkeypatch):
    """The checkpoint has kept where it was, whatever the working directory is now."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["reconstruct", "a.png", "-o", "out"]) == 0
    state = calls[0][2]["checkpoint"]
    Path("out").mkdir(exist_ok=True)
    identity = Identity("a.png", "", "", "", {}, "", "", "", "")
    about = checkpoint._About(1, identity, "", {}, {}, state._file)
    content = np.frombuffer(json.dumps(asdict(about)).encode(), np.uint8)
    with Path("out", CHECKPOINT).open("wb") as file:
        np.savez(file, about=content)
    monkeypatch.chdir("/")
    for arguments in (["--resume", str(tmp_path / "out")], ["--resume", "-o", f"{tmp_path}/out"]):
        assert cli.main(["reconstruct", *arguments]) == 0
        _, (read,), options = calls[-1]
        assert read.source == "a.png"
        assert options["checkpoint"].stage == 1


def test_what_to_open_next(photo, calls, tmp_path, capsys, monkeypatch):
    """Beside the montage's path, the only line on standard output."""
    monkeypatch.setattr("unlit.report.bundle.program", lambda: None)
    monkeypatch.setattr("unlit.report.bundle.missing_because", lambda: "npm was away")
    folder = tmp_path / "my face"
    assert cli.main(["reconstruct", photo, "-o", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert out == f"{folder / 'montage.png'}\n"
    *_, opened, viewer = err.splitlines()
    assert str(folder / "report.html") in opened
    assert f"`unlit view '{folder}'`" in opened
    assert "npm was away" in viewer


def test_a_finished_result_is_neither_resumed_nor_replaced(
    photo, calls, tmp_path, capsys, monkeypatch
):
    """Finished is finished; a result of another photo, or done otherwise, is refused."""
    (tmp_path / MARK).write_text(MARK_TEXT)
    photographed = types.SimpleNamespace(name="a.png")
    same = types.SimpleNamespace(photo=photographed, settings=PRESETS["standard"])
    arguments = ["reconstruct", photo, "-o", str(tmp_path), "--resume"]
    monkeypatch.setattr("unlit.output.load.load", lambda _: same)
    assert cli.main(arguments) == 0
    assert "montage.png" in capsys.readouterr().out
    assert cli.main([*arguments, "--preset", "draft"]) == 1
    assert "holds a finished result of a.png" in capsys.readouterr().err
    photographed.name = "b.png"
    assert cli.main(arguments) == 1
    assert "holds a finished result of b.png" in capsys.readouterr().err
    assert not calls


def test_without_resume_nothing_is_read(photo, calls, tmp_path):
    """A broken checkpoint does not stop a new run."""
    (tmp_path / CHECKPOINT).write_bytes(b"broken")
    assert cli.main(["reconstruct", photo, "-o", str(tmp_path)]) == 0
    assert cli.main(["reconstruct", photo, "-o", str(tmp_path), "--resume"]) == 1
    assert len(calls) == 1


def test_from_stage(calls, tmp_path, capsys):
    """The saved settings, with --set on top; into the same folder or another; edits are named."""
    folder = tmp_path / "old"
    folder.mkdir()
    arguments = ["reconstruct", "--resume", str(folder), "--from-stage", "4", "--set", "clip=3"]
    assert cli.main(arguments) == 0
    assert cli.main([*arguments, "-o", str(tmp_path / "new")]) == 0
    for name, (_, stage, settings, *_), _ in calls:
        assert (name, stage) == ("resume", 4)
        assert (settings.resolution, settings.clip, settings.stage5.iterations) == (300, 3.0, 7)
    out, err = capsys.readouterr()
    assert [Path(line).parent for line in out.splitlines()] == [folder, tmp_path / "new"]
    assert "mask.png" in err
    assert "landmark_residual  0.02" in err
    assert "warning  dark" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("PHOTO",), "no folder to write given; add -o DIR"),
        (("-o", "x"), "no PHOTO given"),
        (("--resume", "x"), "x: no unfinished run there that tells its photo; name it"),
        (("--resume", "-o", "x"), "x: no unfinished run there"),
        (("PHOTO", "--resume", "x", "-o", "y"), "--resume x and -o y differ"),
        (("--from-stage", "2"), "name the folder of the result"),
        (("PHOTO", "--resume", "x", "--from-stage", "2"), "PHOTO has no use with --from-stage"),
        (("--resume", "x", "--from-stage", "2", "--mask", "m"), "--mask has no use"),
        (("--resume", "x", "--from-stage", "2", "--preset", "draft"), "--preset has no use"),
        (("--resume", "x", "--from-stage", "2", "--resolution", "300"), "--resolution has no use"),
        (("--resume", "x", "--from-stage", "2", "--memory", "4GB"), "--memory has no use"),
        (("--resume", "x", "--from-stage", "2", "--model", "ict"), "--model has no use"),
        (("--resume", "x", "--from-stage", "2", "--light-color", "auto"), "--light-color has no"),
    ],
)
def test_wrong_usage_is_2_and_one_line(photo, calls, capsys, arguments, said):
    """Options that contradict each other, or that would be dropped."""
    given = [{"PHOTO": photo}.get(word, word) for word in arguments]
    assert cli.main(["reconstruct", *given]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not calls


def test_mask(photo, calls, tmp_path, capsys):
    """Handed on and said in the log."""
    assert cli.main(["reconstruct", photo, "-o", str(tmp_path / "o"), "--mask", "skin.png"]) == 0
    assert calls[0][2]["mask"] == "skin.png"
    assert "skin.png" in capsys.readouterr().err
