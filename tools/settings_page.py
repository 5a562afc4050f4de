"""The tables of docs/settings.md: every setting, from the dataclasses in src/unlit/settings/.

A setting's text is the comment above it (`#:`), or what the docstring of its class says after its
name ("name: text"). The reason is where docs/method.md names it, the figures where the lab notes
do. tests/unit/tools/test_settings_page.py holds that no setting is without text and reason.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from unlit.settings.conditions import KnownExposure, LightColorRequest
from unlit.settings.ranges import expected
from unlit.settings.settings import PRESETS
from unlit.settings.table1 import TABLE_1, Stage

DOCS = Path(__file__).resolve().parents[1] / "docs"
#: Written as text, and told by their own comment.
_REQUESTS = (LightColorRequest, KnownExposure)
_READINGS = "Readings of what the paper leaves open, and what was added to it."
_GEOMETRY = {"landmark_fit", "outline_fit", "shading_fit", "head_model"}


@dataclass(frozen=True)
class Entry:
    """One setting. name: dotted. values: by preset, in the order of PRESETS. takes: its range.

    text: what it is. reason, figures: (title, link) of a heading in the docs, or None.
    """

    name: str
    values: tuple[Any, ...]
    takes: str
    text: str
    reason: tuple[str, str] | None
    figures: tuple[str, str] | None


def comments(kind: type) -> dict[str, str]:
    """What `#:` comments say of the fields of a dataclass; it holds until the next blank line."""
    lines = inspect.getsource(kind).splitlines()
    found: dict[str, str] = {}
    said: list[str] = []
    fresh = False
    for line in map(str.strip, lines):
        if line.startswith("#:"):
            said = ([] if not fresh else said) + [line[2:].strip()]
            fresh = True
            continue
        fresh = False
        if not line:
            said = []
        elif (name := re.match(r"(\w+): ", line)) and said:
            found[name[1]] = " ".join(said)
    return found


def described(kind: type) -> dict[str, str]:
    """What the docstring of a dataclass says of its fields: "name, other: text"."""
    names = "|".join(field.name for field in fields(kind))
    text = " ".join((inspect.getdoc(kind) or "").split())
    heads = list(re.finditer(rf"(?:(?<=[.;:,] )|^)((?:{names})(?:, (?:{names}))*): ", text))
    found: dict[str, str] = {}
    ends = [head.start() for head in heads[1:]] + [len(text)]
    for head, end in zip(heads, ends, strict=False):
        said = text[head.end() : end].strip(" ;.,")
        found |= dict.fromkeys(head[1].split(", "), said)
    return found


def introduction(kind: type) -> str:
    """The docstring of a dataclass up to the first field it tells of."""
    text = " ".join((inspect.getdoc(kind) or "").partition(">>>")[0].split())
    first = re.search(rf"\b(?:{'|'.join(f.name for f in fields(kind))})(?:, \w+)*: ", text)
    return text[: first.start() if first else len(text)].strip()


def anchor(heading: str) -> str:
    """The fragment of a heading, as the site and code hosts make it, for plain English."""
    plain = re.sub(r"[`*]|\[([^]]*)\]\([^)]*\)", r"\1", heading)
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


@cache
def _sections(path: Path) -> list[tuple[str, str, str]]:
    """(title, fragment, text) of each section of a page, in order."""
    found: list[tuple[str, str, str]] = []
    used: dict[str, int] = {}
    for part in re.split(r"^(?=#{1,4} )", path.read_text(encoding="utf-8"), flags=re.M)[1:]:
        heading, _, body = part.partition("\n")
        title = heading.lstrip("# ")
        slug = anchor(title)
        used[slug] = used.get(slug, -1) + 1
        found.append((title, f"{slug}_{used[slug]}" if used[slug] else slug, body))
    return found


def _named(body: str, name: str) -> bool:
    """Whether `name`, or the group it is in, stands in a text as code."""
    return re.search(rf"`{re.escape(name)}(?:[=.][^`]*)?`", body) is not None


def _title(title: str) -> str:
    return re.sub(r":? `.*", "", title).strip()


def reason(name: str) -> tuple[str, str] | None:
    """Where docs/method.md says why: the section whose "Settings:" line has it or its group."""
    for title, fragment, body in _sections(DOCS / "method.md"):
        listed = " ".join(re.findall(r"Settings: [^\[]*", body))
        if _named(listed, name) or _named(listed, name.partition(".")[0]):
            return _title(title), f"method.md#{fragment}"
    return None


def figures(name: str) -> tuple[str, str] | None:
    """The first section of the lab notes that names the setting."""
    pages = sorted((DOCS / "lab").glob("*.md"), key=lambda path: "method" not in path.name)
    if name.partition(".")[0] in _GEOMETRY:
        pages = [DOCS / "geometry.md", *pages]
    for path in pages:
        for title, fragment, body in _sections(path):
            table = title.startswith("11. What was added")
            if not table and _named(body, name):
                link = path.relative_to(DOCS).as_posix()
                return _title(title), f"{link}#{fragment}"
    return None


def entries(group: Any = None, prefix: str = "") -> Iterator[Entry]:
    """All settings but the stages, in the order of the code."""
    groups = group or tuple(PRESETS.values())
    kind = type(groups[0])
    texts = described(kind) | comments(kind)
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        values = tuple(getattr(one, field.name) for one in groups)
        name = prefix + field.name
        if isinstance(values[0], Stage):
            continue
        if is_dataclass(values[0]) and not isinstance(values[0], _REQUESTS):
            yield from entries(values, f"{name}.")
            continue
        request = isinstance(values[0], _REQUESTS)
        yield Entry(
            name,
            tuple(value.text if request else value for value in values),
            "text" if request else _takes(hints[field.name]),
            texts.get(field.name, ""),
            reason(name),
            figures(name),
        )


def plain(value: Any) -> str:
    """A value as `--set` takes it."""
    if isinstance(value, tuple):
        return ",".join(plain(part) for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _cell(text: str) -> str:
    """Text for a table: no pipes; names of code stay as they are."""
    return text.replace("|", "\\|").replace("*", "\\*")


def _takes(kind: Any) -> str:
    """A range in words; bounds that only keep numbers finite are left out."""
    text = expected(kind).replace("float, ", "").replace("int,", "whole,")
    return re.sub(r", at most (1e\+06|100000)\b", "", text).replace("str", "text")


def _links(entry: Entry) -> str:
    shown = [f"[{title}]({link})" for title, link in filter(None, (entry.reason, entry.figures))]
    return ", ".join(dict.fromkeys(shown))


def _values(entry: Entry) -> str:
    """The default of each preset, once where all agree."""
    shown = [f"`{plain(value)}`" for value in entry.values]
    if len(set(shown)) == 1:
        return shown[0]
    by_value: dict[str, list[str]] = {}
    for preset, value in zip(PRESETS, shown, strict=True):
        by_value.setdefault(value, []).append(preset)
    return "<br>".join(f"{value} {', '.join(presets)}" for value, presets in by_value.items())


def table(chosen: list[Entry]) -> list[str]:
    """The rows of a table; each name is the target of a link."""
    lines = ["| setting | default | takes | what it is | why, figures |", "|---|---|---|---|---|"]
    for entry in chosen:
        name = f'<span id="{entry.name}">`{entry.name}`</span>'
        cells = (name, _values(entry), entry.takes, _cell(entry.text), _links(entry))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def stages() -> list[str]:
    """Table 1, each weight once for `paper`, and what `standard` has where it differs."""
    lines = [
        f"| field | {' | '.join(TABLE_1)} | takes | what it is |",
        "|" + "---|" * (len(TABLE_1) + 3),
    ]
    hints, texts = get_type_hints(Stage, include_extras=True), described(Stage)
    for field in fields(Stage):
        cells: list[str] = []
        for name in TABLE_1:
            paper, standard = (
                plain(getattr(getattr(PRESETS[preset], name), field.name))
                for preset in ("paper", "standard")
            )
            cells.append(paper if paper == standard else f"{paper} ({standard})")
        row = (f"`{field.name}`", *cells, _takes(hints[field.name]), _cell(texts[field.name]))
        lines.append(f"| {' | '.join(row)} |")
    return lines


def page() -> str:
    """The Markdown that stands for the mark in docs/settings.md."""
    every = list(entries())
    lines = ["## The five stages", "", "`stage1` to `stage5`; in brackets, what `standard` and"]
    lines += [
        "`draft` have instead: [method](method.md#stage-1-base-colour-and-light-31).",
        "",
    ]
    lines += [*stages(), "", "## One value each", "", _READINGS, ""]
    lines += table([entry for entry in every if "." not in entry.name])
    by_group: dict[str, list[Entry]] = {}
    for entry in every:
        if "." in entry.name:
            by_group.setdefault(entry.name.rpartition(".")[0], []).append(entry)
    for group, members in by_group.items():
        kind = type(_at(PRESETS["paper"], group))
        lines += ["", f"## `{group}`", "", introduction(kind), "", *table(members)]
    return "\n".join(lines) + "\n"


def _at(settings: Any, name: str) -> Any:
    for part in name.split("."):
        settings = getattr(settings, part)
    return settings
