"""Docstrings as this project writes them, for mkdocstrings: a griffe extension.

A line "name: text" of an argument, field or attribute becomes an item of a list, an example after
`>>>` a block of code; the rest is Markdown already.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

#: Whose fields have a page of their own.
_TOLD_ELSEWHERE = ("Settings",)
_ITEM = re.compile(r"(?:(?<=[.;] )|(?<=[.;]  )|(?<=\A))((?:\w+)(?:, \w+)*): ")


def markdown(text: str, names: set[str]) -> str:
    """The docstring with lists for what it says of `names`, and fences about its examples."""
    parts = re.split(r"\n\s*\n", text.strip())
    return "\n\n".join(
        _example(part) if part.startswith(">>>") else _items(part, names) for part in parts
    )


def _example(part: str) -> str:
    return f"```pycon\n{part}\n```"


def _items(part: str, names: set[str]) -> str:
    if part.startswith("    "):
        return part  # a block of code or a formula
    flat = " ".join(part.split())
    last = re.search(r"(?<=\.) (?:Raises|Returns) ", flat)
    flat, after = (flat[: last.start()], flat[last.start() :]) if last else (flat, "")
    starts = [m for m in _ITEM.finditer(flat) if set(m[1].split(", ")) <= names]
    if not starts:
        return part
    lines = [flat[: starts[0].start()].strip(), ""] if starts[0].start() else []
    ends = [m.start() for m in starts[1:]] + [len(flat)]
    for match, end in zip(starts, ends, strict=True):
        shown = ", ".join(f"`{name}`" for name in match[1].split(", "))
        lines.append(f"- {shown}: {flat[match.end() : end].strip(' ;')}")
    return "\n".join([*lines, "", after.strip()])


class PlainDocstrings(griffe.Extension):
    """Rewrites each docstring once it, and what it may tell of, has been read."""

    def on_function_instance(self, *, func: griffe.Function, **_: Any) -> None:
        if func.docstring is not None:
            names = {parameter.name for parameter in func.parameters}
            func.docstring.value = markdown(func.docstring.value, names)

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Fields that the docstring does not tell of are listed with their types."""
        fields = {
            name: str(member.annotation)
            for name, member in cls.members.items()
            if isinstance(member, griffe.Attribute) and member.annotation and name[0] != "_"
        }
        if cls.docstring is not None:
            text = markdown(cls.docstring.value, set(fields))
            told = {name for line in text.splitlines() for name in _told(line)}
            others = [f"- `{name}`: `{kind}`" for name, kind in fields.items() if name not in told]
            listed = cls.name not in _TOLD_ELSEWHERE and others
            cls.docstring.value = "\n".join([text, "", *others]) if listed else text


def _told(line: str) -> list[str]:
    """The fields that an item of a list tells of."""
    found = re.match(r"- ((?:`\w+`(?:, )?)+): ", line)
    return re.findall(r"\w+", found[1]) if found else []
