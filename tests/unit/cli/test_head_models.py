"""`unlit models add` and `--model`: what reaches the library, and mistakes in one line."""

import pytest

from unlit import cli
from unlit.head.sources import library


def test_add_builds_of_the_folder_and_says_where(home, monkeypatch, capsys) -> None:
    """Its path is the only line on standard output."""
    asked = []
    monkeypatch.setattr(library, "add", lambda name, source, _: asked.append((name, source)) or "x")
    assert cli.main(["models", "add", "ict", str(home)]) == 0
    assert asked == [("ict", home)]
    assert capsys.readouterr().out == "x\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("add",), "unlit models add ict FOLDER"),
        (("add", "ict"), "unlit models add ict FOLDER"),
        (("add", "flame", "."), "flame: no such head model to add"),
        (("add", "ict", "no/such/folder"), "not a folder"),
        (("add", "ict", "."), "holds no generic_neutral_mesh.obj"),
        (("fetch", "ict"), "ict: has no use with fetch"),
    ],
)
def test_wrong_usage_is_one_line(home, monkeypatch, capsys, arguments, said) -> None:
    """Nothing is built, fetched or written."""
    monkeypatch.chdir(home)
    assert cli.main(["models", *arguments]) != 0
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not (home / "heads").exists()


@pytest.mark.parametrize("command", ["reconstruct", "batch", "evaluate"])
def test_an_unknown_model_is_refused_before_the_work(home, monkeypatch, capsys, command) -> None:
    """With what there is to choose from; no result is left behind."""
    import numpy as np
    from PIL import Image

    monkeypatch.setattr(cli.models, "fetch", lambda *_: None)
    Image.fromarray(np.full((80, 90, 3), 128, np.uint8)).save(home / "a.png")
    arguments = [command, str(home / "a.png"), "-o", str(home / "out"), "--model", "flame"]
    assert cli.main(arguments) == 1
    assert "flame: no such head model; give makehuman or" in capsys.readouterr().err
    assert not list(home.glob("out/*"))
