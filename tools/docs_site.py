"""What mkdocs asks while it builds the site (`hooks` in mkdocs.yml).

A line `<!-- made: NAME -->` in a page is replaced by what the code or a file of the repository
says; the lab notes enter the navigation by themselves; each tutorial comes as a notebook, too.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import results_page
import settings_page
import tutorial
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
_MARK = re.compile(r"^<!-- made: (\w+) -->\n", re.M)
_LAB = "Lab notes"


def root_file(name: str) -> str:
    """A Markdown file of the repository's root without its title, links as from docs/."""
    text = (ROOT / name).read_text(encoding="utf-8")
    text = re.sub(r"\A# .*\n+", "", text)
    text = re.sub(r"\[([^]]+)\]\((?!https?:|#|docs/)[^)]*\)", r"`\1`", text)
    return text.replace("](docs/", "](")


MADE: dict[str, Callable[[], str]] = {
    "settings": settings_page.page,
    "results": results_page.page,
    "contributing": lambda: root_file("CONTRIBUTING.md"),
    "changelog": lambda: root_file("CHANGELOG.md"),
}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Every lab note is in the navigation, the index first."""
    notes = sorted((ROOT / "docs" / "lab").glob("*.md"), key=lambda path: path.stem)
    entries: list[Any] = config.nav or []
    for entry in entries:
        if isinstance(entry, dict) and entry.get(_LAB):
            entry[_LAB] += [f"lab/{path.name}" for path in notes if path.stem != "index"]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """A notebook beside each tutorial."""
    for path in sorted(tutorial.FOLDER.glob("*.md")):
        made = tutorial.notebook(path.read_text(encoding="utf-8"))
        files.append(File.generated(config, f"tutorials/{path.stem}.ipynb", content=made))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """The page with what is made for it."""
    if page.file.src_uri.startswith("tutorials/"):
        name = Path(page.file.src_uri).stem
        markdown = re.sub(r"\A(# .*\n)", rf"\1\n[As a notebook]({name}.ipynb)\n", markdown)
    return _MARK.sub(lambda match: MADE[match[1]](), markdown)
