"""What the site is made with: tutorials, docstrings, results, the release's checks."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from pathlib import Path

import check_release
import pytest
import results_page
import stage_diagrams
import tutorial

import unlit

ROOT = Path(__file__).parents[3]
PAGE = """# Title

![picture](a.png)

Words with a [link](../limits.md#x).

```python
a = 1
```

```sh
unlit demo
```

```python
print(a)

print("b")
```
"""


def test_a_tutorial_is_its_python_blocks() -> None:
    assert tutorial.code(PAGE) == ["a = 1\n", 'print(a)\n\nprint("b")\n']


def test_a_notebook_has_the_same_code_and_no_dead_links() -> None:
    made = json.loads(tutorial.notebook(PAGE))
    assert (made["nbformat"], made["nbformat_minor"]) == (4, 5)
    code = [cell["source"] for cell in made["cells"] if cell["cell_type"] == "code"]
    assert [part + "\n" for part in code] == tutorial.code(PAGE)
    words = "".join(cell["source"] for cell in made["cells"] if cell["cell_type"] == "markdown")
    assert "unlit demo" in words and "a link." in words
    assert "](" not in words
    assert len({cell["id"] for cell in made["cells"]}) == len(made["cells"])


def test_the_results_are_all_of_the_benchmark() -> None:
    figures = json.loads(results_page.REFERENCE.read_text())
    cells = re.findall(r"\| (\d+\.\d) (?=\|)", results_page.page())
    assert len(cells) == len(figures)
    subjects = {key.split("/")[1] for key in figures}
    assert all(results_page.NAMES[name] in results_page.page() for name in subjects)


def test_every_public_name_is_on_the_api_page() -> None:
    text = (ROOT / "docs" / "api.md").read_text()
    documented = set(re.findall(r"^::: unlit\.(\w+)$", text, re.M)) | {"__version__"}
    assert "`unlit.__version__`" in text
    assert set(unlit.__all__) <= documented


def test_the_diagrams_are_those_of_the_script() -> None:
    for number, stage in enumerate(stage_diagrams.STAGES, 1):
        kept = (stage_diagrams.FOLDER / f"stage-{number}.svg").read_text()
        assert kept == stage_diagrams.diagram(*stage)


def test_docstrings_become_lists_and_examples_code() -> None:
    pytest.importorskip("griffe")
    from plain_docstrings import markdown

    text = (
        "Do it.\n\na: first. b, c: others,\n    and more. d: no name. Raises Error.\n\n>>> do()\n1"
    )
    found = markdown(text, {"a", "b", "c"})
    assert "- `a`: first." in found
    assert "- `b`, `c`: others, and more. d: no name.\n" in found
    assert "\n\nRaises Error." in found
    assert found.endswith("```pycon\n>>> do()\n1\n```")


def test_fields_without_a_word_are_listed_with_their_type(tmp_path: Path) -> None:
    griffe = pytest.importorskip("griffe")
    from plain_docstrings import PlainDocstrings

    docstring = '"""Data.\n\n    a, b: numbers.\n    """'
    (tmp_path / "shown.py").write_text(
        f"class A:\n    {docstring}\n\n    a: int\n    b: int\n    c: str\n"
    )
    extensions = griffe.load_extensions(PlainDocstrings())
    module = griffe.load("shown", search_paths=[tmp_path], extensions=extensions)
    lines = module["A"].docstring.value.splitlines()
    assert [line for line in lines if line] == ["Data.", "- `a`, `b`: numbers.", "- `c`: `str`"]


@pytest.fixture
def release(tmp_path: Path) -> Path:
    for name in ("pyproject.toml", "CHANGELOG.md", "CITATION.cff"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def test_versions_agree(release: Path) -> None:
    assert not list(check_release.version_faults())
    for name, before, after in (
        ("CHANGELOG.md", "## 0.1.0", "## 0.0.9"),
        ("CITATION.cff", "version: 0.1.0", "version: 0.2.0"),
    ):
        text = (release / name).read_text()
        (release / name).write_text(text.replace(before, after))
        assert any(name in fault for fault in check_release.version_faults(release))
        (release / name).write_text(text)


def test_a_release_has_a_date(release: Path) -> None:
    changelog = release / "CHANGELOG.md"
    text = re.sub(r"^(## \S+) \(.+\)$", r"\1 (not released)", changelog.read_text(), flags=re.M)
    changelog.write_text(text)
    assert list(check_release.version_faults(release, released=True))
    changelog.write_text(text.replace("(not released)", "(2026-12-01)"))
    assert not list(check_release.version_faults(release, released=True))


def test_a_wheel_without_its_data_is_told(tmp_path: Path) -> None:
    """The list of data is that of the package: each file is in the sources, but for the viewer."""
    made = [name for name in check_release.DATA if name != "report/web/viewer.js"]
    assert all((ROOT / "src" / "unlit" / name).is_file() for name in made)
    wheel = tmp_path / "unlit-1-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in (*check_release.DATA[1:], "../other/x.py"):
            archive.writestr(f"unlit/{name}".replace("unlit/../", ""), "")
        for name in ("LICENSE", "NOTICE"):
            archive.writestr(f"unlit-1.dist-info/licenses/{name}", "")
    faults = list(check_release.wheel_faults(wheel))
    assert len(faults) == 2
    assert check_release.DATA[0] in faults[0] and "also installs other" in faults[1]


def test_the_site_is_built_and_fetches_nothing(tmp_path: Path) -> None:
    """Strict: a dead link is an error. No page asks another's server for anything."""
    pytest.importorskip("mkdocs")
    pytest.importorskip("mkdocstrings")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path)))
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(?:script|img|link)[^>]+(?:src|href)=.?https?://", text), page
        assert "<!-- made:" not in text, page
    assert "max_diffuse" in (tmp_path / "settings.html").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "tutorials" / "first-face.ipynb").read_text())["cells"]
