"""The page of settings: all are there, with text and a reason that leads somewhere."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest
import settings_page
from settings_page import Entry, anchor, comments, described, entries, introduction, page

from unlit.settings.settings import PRESETS, as_dict, flat, override

DOCS = Path(__file__).parents[3] / "docs"
ENTRIES = list(entries())


@dataclass
class Group:
    """Lengths: pixels. near, far: from the wall; high: above it. Odd
    words: are no field.

    loud: so.
    """

    near: int = 1
    far: int = 2
    high: int = 3
    loud: int = 4

    #: What both
    #: of them are.
    left: int = 5
    right: int = 6

    alone: int = 7


def test_texts_come_from_docstring_and_comments() -> None:
    assert described(Group) == {
        "near": "from the wall",
        "far": "from the wall",
        "high": "above it. Odd words: are no field",
        "loud": "so",
    }
    assert comments(Group) == dict.fromkeys(("left", "right"), "What both of them are.")
    assert introduction(Group) == "Lengths: pixels."


def test_every_setting_is_on_the_page() -> None:
    names = {name for name in flat(as_dict(PRESETS["paper"])) if not name.startswith("stage")}
    assert {entry.name for entry in ENTRIES} == names
    text = page()
    assert all(f'<span id="{name}">' in text for name in names)
    stages = {name.split(".")[1] for name in flat(as_dict(PRESETS["paper"])) if "stage1." in name}
    assert all(f"| `{name}` |" in text for name in stages)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_a_setting_has_text_and_reason(entry: Entry) -> None:
    """Written in src/unlit/settings/, and named in a "Settings:" line of docs/method.md."""
    assert entry.text
    assert entry.reason is not None
    for _, link in filter(None, (entry.reason, entry.figures)):
        path, _, fragment = link.partition("#")
        headings = re.findall(r"^#+ (.+)$", (DOCS / path).read_text(), re.M)
        slugs = [anchor(heading) for heading in headings]
        assert re.sub(r"_\d+$", "", fragment) in slugs


def test_values_on_the_page_are_values_that_override_takes() -> None:
    for entry in ENTRIES:
        for preset, value in zip(PRESETS, entry.values, strict=True):
            text = settings_page.plain(value)
            assert override(PRESETS[preset], {entry.name: text}) == PRESETS[preset]


def test_many_settings_lead_to_figures() -> None:
    assert sum(entry.figures is not None for entry in ENTRIES) > 20
