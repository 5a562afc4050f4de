"""--json: one object on standard output, whatever comes of it; nothing else beside it."""

import argparse
import json
import math
import types
from pathlib import Path

import pytest

from saved_head import saved_head
from unlit import cli
from unlit.cli.answer import answer
from unlit.machine import doctor
from unlit.machine.doctor import Check


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return saved_head(tmp_path_factory.mktemp("saved")).result


def answered(capsys, *arguments: str) -> tuple[int, dict, str]:
    """Exit code, the object, standard error."""
    code = cli.main([*arguments, "--json"])
    said = capsys.readouterr()
    assert said.out.count("\n") == 1
    return code, json.loads(said.out), said.err


def test_relight_names_its_files(result, tmp_path, capsys):
    path = tmp_path / "flash.png"
    code, said, error = answered(
        *(capsys, "relight", str(result), "--light", "flash", "--fast", "-o", str(path))
    )
    assert (code, said["command"], said["files"]) == (0, "relight", [str(path)])
    assert said["seconds"] > 0 and path.exists()
    assert "preparing" in error


def test_export_names_what_it_wrote(result, tmp_path, capsys):
    out = tmp_path / "export"
    out.mkdir()
    (out / "notes.txt").write_text("somebody's")
    code, said, _ = answered(
        *(capsys, "export", str(result), "-o", str(out), "--format", "ply", "--size", "512")
    )
    assert code == 0 and said["folder"] == str(out)
    assert sorted(said["files"]) == sorted(
        str(file) for file in out.iterdir() if file.name != "notes.txt"
    )


def test_an_error_is_an_object_too(tmp_path, capsys):
    """The same line as on standard error, and the exit code."""
    code, said, error = answered(capsys, "montage", str(tmp_path / "absent"))
    assert code == said["code"] == 1
    assert error == f"unlit: error: {said['error']}\n"


@pytest.mark.parametrize(
    ("line", "named"),
    [
        (("relight",), "required: DIR, --light"),
        (("models", "bogus"), "bogus"),
        (("nonsense",), "nonsense"),
        (("cite", "--bibtxe"), "--bibtxe: did you mean --bibtex?"),
    ],
)
def test_an_error_of_the_arguments_is_an_object_too(capsys, line, named):
    """The usage is for people: on standard error only."""
    code, said, error = answered(capsys, *line)
    assert code == said["code"] == 2
    assert error.startswith("usage: unlit") and named in said["error"]
    assert error.endswith(f"unlit: error: {said['error']}\n")


def test_json_cut_short_counts_for_errors_as_well(capsys):
    """argparse takes --js for it, but says so only if there is no error."""
    assert cli.main(["relight", "--js"]) == 2
    assert json.loads(capsys.readouterr().out)["code"] == 2


def test_numbers_that_json_does_not_have_are_null(capsys):
    """A loss may be NaN, of a run that went wrong: no reason to say nothing."""
    options = argparse.Namespace(json=True, began=0.0, command="reconstruct")
    losses = {"stage1": math.nan, "stage2": 0.5}
    answer(options, "", losses=losses, rows=[(math.inf, Path("/a"))])
    said = json.loads(capsys.readouterr().out)
    assert said["losses"] == {"stage1": None, "stage2": 0.5}
    assert said["rows"] == [[None, "/a"]]


def test_doctor_answers_with_its_checks(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "checks", lambda: [Check("disk", False, "full", "free some")])
    code, said, _ = answered(capsys, "doctor")
    assert code == 1 and said["ok"] is False
    assert said["checks"][0] == {
        "name": "disk",
        "ok": False,
        "detail": "full",
        "remedy": "free some",
    }


def test_models_answers_with_sums_and_paths(capsys):
    code, said, _ = answered(capsys, "models")
    assert code == 0
    for model in said["models"]:
        assert len(model["sha256"]) == 64 and model["licence"]
        assert (model["path"] is None) <= bool(model["problem"])


def test_reconstruct_answers_with_files_warnings_and_metrics(result, tmp_path, capsys):
    """Of a result that was finished before, as of one that is new."""
    from unlit.cli.reconstruct import _say_finished
    from unlit.output.load import load

    options = types.SimpleNamespace(json=True, began=0.0, command="reconstruct")
    _say_finished(options, result, load(result))  # pyright: ignore[reportArgumentType]
    shown = capsys.readouterr()
    said = json.loads(shown.out)
    assert str(result / "montage.png") in said["files"]
    assert said["warnings"] == list(load(result).metrics.warnings)
    assert {"render_psnr_db", "landmark_residual", "steps_seconds", "losses"} <= said[
        "metrics"
    ].keys()
    assert "report.html" in shown.err and "unlit view" in shown.err
