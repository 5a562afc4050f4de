"""The tutorials run as they are written, block by block."""

from __future__ import annotations

from pathlib import Path

import pytest
import tutorial

PAGES = sorted(tutorial.FOLDER.glob("*.md"))


def test_there_are_three() -> None:
    assert len(PAGES) >= 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of all tutorials, as a reader's would be: one goes on with what another left."""
    return tmp_path_factory.mktemp("tutorials")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_runs(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one namespace; a block that fails is named by the compiler."""
    monkeypatch.chdir(folder)
    blocks = tutorial.code(page.read_text(encoding="utf-8"))
    assert len(blocks) >= 3
    names: dict[str, object] = {"__name__": "__main__"}
    for number, block in enumerate(blocks, 1):
        exec(compile(block, f"{page.stem}, block {number}", "exec"), names)
