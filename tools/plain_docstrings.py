"""Docstrings as this project writes them, for mkdocstrings: a griffe extension.

A line "name: text" of an argument, field or attribute becomes an item of a list, an example after
`>>>` a block of code; the rest is Markdown already.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

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
    if re.search(r"^    ", part, re.M) and part.startswith("    "):
        return part  # a block of code or a formula
    flat, after = re.fullmatch(
        r"(.*?)((?:(?<=\.) (?:Raises|Returns) .*)?)", " ".join(part.split())
    ).groups()
    starts = [m for m in _ITEM.finditer(flat) if set(m[1].split(", ")) <= names]
    if not starts:
        return part
    lines = [flat[: starts[0].start()].strip(), ""] if starts[0].start() else []
    ends = [m.start() for m in starts[1:]] + [len(flat)]
    for match, end in zip(starts, ends, strict=True):
        shown = ", ".join(f"`{name}`" for name in match[1].split(", "))
        lines.append(f"- {shown}: {flat[match.end() : end].strip()}")
    return "\n".join([*lines, "", after.strip()])


class PlainDocstrings(griffe.Extension):
    """Rewrites each docstring once it, and what it may tell of, has been read."""

    def on_function_instance(self, *, func: griffe.Function, **_: Any) -> None:
        _rewrite(func, {parameter.name for parameter in func.parameters})

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        _rewrite(cls, {name for name, member in cls.members.items() if member.is_attribute})


def _rewrite(member: griffe.Object, names: set[str]) -> None:
    if member.docstring is not None:
        member.docstring.value = markdown(member.docstring.value, names)
