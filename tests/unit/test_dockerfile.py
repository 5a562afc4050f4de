"""The Dockerfile copies what is there, and runs a command that is one; no Docker needed."""

import json
import re
from pathlib import Path

from unlit import cli

ROOT = Path(__file__).parents[2]
LINES = re.sub(r"\\\n", " ", (ROOT / "Dockerfile").read_text()).splitlines()


def instructions(name: str) -> list[str]:
    return [line.split(maxsplit=1)[1] for line in LINES if line.startswith(f"{name} ")]


def test_what_is_copied_exists_and_is_let_through() -> None:
    let_through = re.findall(r"^!(.+)$", (ROOT / ".dockerignore").read_text(), re.M)
    copied = [source for line in instructions("COPY") for source in line.split()[:-1]]
    assert copied
    for source in copied:
        assert (ROOT / source).exists(), source
        assert source in let_through, source


def test_what_the_build_reads_is_copied() -> None:
    copied = {source for line in instructions("COPY") for source in line.split()[:-1]}
    project = (ROOT / "pyproject.toml").read_text()
    named = {"README.md", "LICENSE", "NOTICE", "hatch_build.py", "viewer", "src", "pyproject.toml"}
    assert all(f'"{name}"' in project for name in ("README.md", "LICENSE", "NOTICE"))
    assert named <= copied


def test_it_runs_the_demo() -> None:
    [entry], [arguments] = instructions("ENTRYPOINT"), instructions("CMD")
    assert json.loads(entry) == ["unlit"]
    options = cli._parser().parse_args(json.loads(arguments))
    assert options.run.__module__ == "unlit.cli.demo"
    fetch = next(line for line in instructions("RUN") if line.startswith("unlit "))
    assert cli._parser().parse_args(fetch.split()[1:]).run.__module__ == "unlit.cli.models"


def test_python_is_one_that_unlit_takes() -> None:
    [image] = instructions("FROM")
    minor = int(re.fullmatch(r"python:3\.(\d+)-slim", image)[1])  # type: ignore[index]
    assert 11 <= minor <= 13


def test_it_does_not_run_as_root() -> None:
    assert LINES.index("USER face") < next(
        number for number, line in enumerate(LINES) if line.startswith("ENTRYPOINT")
    )
