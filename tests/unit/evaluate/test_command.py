"""`unlit evaluate`: one-line errors before any work is done, and what it writes."""

import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import plates
from table_of_figures import RESULT
from unlit import cli
from unlit.errors import PictureError
from unlit.evaluate import command
from unlit.evaluate.table import tables
from unlit.output.images import exr
from unlit.scene.light import RASTER


@pytest.fixture(autouse=True)
def no_fetching(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli.models, "fetch", lambda *commands: None)


def run(capsys: Any, *arguments: str) -> tuple[int, str, str]:
    try:
        code = cli.main(["evaluate", *arguments])
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return (code, *capsys.readouterr())


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (("nowhere",), 1, "nowhere: cannot be read (No such file or directory)"),
        (("SUBJECT", "--lights", "flash,moon"), 2, "moon: no such light; give flash, uniform"),
        (("SUBJECT", "--lights", "none.hdr"), 1, "none.hdr: cannot be read"),
        (("SUBJECT", "other"), 2, "one subject at a time, or photos with --same-person"),
        (("SUBJECT", "--lights", "flash,flash"), 2, "two lights are called 'flash'"),
        (("SUBJECT", "--lights", "side", "--ablation"), 2, "an ablation needs flash or uniform"),
        (("SUBJECT", "--face", "1"), 2, "--face has no use with a subject"),
        (("SUBJECT", "--check", "--samples", "8"), 2, "--samples has no use with --check"),
        (("a.jpg", "b.jpg", "--same-person", "--true-mesh"), 2, "--true-mesh has no use"),
        (("SUBJECT", "--config", "DEEP"), 2, "deep.toml: no valid TOML"),
        (("one.jpg", "--same-person"), 1, "takes two photos or more"),
        (("SUBJECT", "--set", "stage9.iterations=1"), 2, "stage9"),
    ],
)
def test_mistakes(
    capsys: Any, tmp_path: Path, arguments: tuple[str, ...], code: int, reason: str
) -> None:
    """One line, the right exit code, and no folder is left behind by a mistyped name."""
    subject = str(plates.folder(tmp_path))
    deep = tmp_path / "deep.toml"
    deep.write_text("a = " + "[" * 100_000)
    places = {"SUBJECT": subject, "DEEP": str(deep)}
    arguments = tuple(places.get(a, a) for a in arguments)
    found, out, err = run(capsys, *arguments, "-o", str(tmp_path / "out"))
    assert (found, out) == (code, "")
    assert reason in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_check(capsys: Any, tmp_path: Path) -> None:
    """Three lights and three maps in one picture, whose path is printed."""
    out = tmp_path / "out"
    code, printed, _ = run(
        capsys, str(plates.folder(tmp_path)), "-o", str(out), "--check", "--resolution", "256"
    )
    assert (code, printed) == (0, f"{out / 'check.png'}\n")
    assert (out / "check.png").stat().st_size > 10_000


def test_what_is_written(tmp_path: Path) -> None:
    """JSON, Markdown and HTML of the same figures."""
    tmp_path.joinpath("out").mkdir()
    result = {"rows": RESULT["rows"]}
    path = command._write(tmp_path / "out", "Someone", ["a fact"], tables(result), result, [])
    text = path.read_text()
    assert text.startswith("# Someone")
    assert "the paper's Table 2" in text
    assert json.loads((tmp_path / "out/evaluation.json").read_text()) == result
    assert "Someone" in (tmp_path / "out/evaluation.html").read_text()


def test_lights(tmp_path: Path) -> None:
    """By name, and from a file: values as they are, negative ones cut."""
    for name in command.LIGHTS:
        assert command.light(name).environment.shape == RASTER
    sky = np.random.default_rng(0).uniform(-0.1, 40, (8, 16, 3)).astype(np.float32)
    (tmp_path / "sky.exr").write_bytes(exr(sky))
    found = command.light(str(tmp_path / "sky.exr"))
    assert found.name == "sky"
    assert found.environment == pytest.approx(np.maximum(sky, 0))
    (tmp_path / "cut.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n")
    (tmp_path / "huge.hdr").write_bytes(b"#?RADIANCE\n\n-Y 80000 +X 16\n")
    (tmp_path / "wide.hdr").write_bytes(b"#?RADIANCE\n\n-Y 8193 +X 16384\n")
    for name, reason in (
        ("cut.hdr", "no whole picture"),
        ("huge.hdr", "at most 16384"),
        ("wide.hdr", "at most 134 million"),
    ):
        with pytest.raises(PictureError, match=reason):
            command.light(str(tmp_path / name))
