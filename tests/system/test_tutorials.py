"""The tutorials run as they are written, block by block."""

from __future__ import annotations

from pathlib import Path

import pytest
import tutorial

PAGES = sorted(tutorial.FOLDER.glob("*.md"))


def test_there_are_three() -> None:
    assert len(PAGES) >= 3


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one namespace and a folder of its own; a block that fails is named by the compiler."""
    monkeypatch.chdir(tmp_path)
    blocks = tutorial.code(page.read_text(encoding="utf-8"))
    assert len(blocks) >= 3
    names: dict[str, object] = {"__name__": "__main__"}
    for number, block in enumerate(blocks, 1):
        exec(compile(block, f"{page.stem}, block {number}", "exec"), names)
