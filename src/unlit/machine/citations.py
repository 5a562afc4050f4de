"""What to cite for a result, as citations.toml lists it: in a line each, and as BibTeX."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import msgspec

#: The entry of unlit itself, whose version is added.
OURS = "unlit"


@dataclass(frozen=True)
class Citation:
    """One work that a result of unlit stands on.

    key: of its BibTeX entry.  use: when it is to be cited.  kind: of the BibTeX entry.
    authors: full names, first name first; in braces where one is not a person's.
    year: None where the work has none.  venue: journal or proceedings, or empty.
    note: maker and licence, or empty.
    assets: the files of manifest.py that it stands for.
    """

    key: str
    use: str
    kind: Literal["article", "inproceedings", "misc", "software"]
    title: str
    authors: tuple[str, ...]
    year: int | None = None
    venue: str = ""
    note: str = ""
    assets: tuple[str, ...] = ()


def citations() -> list[Citation]:
    """All of them, in the order of citations.toml."""
    content = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return msgspec.convert(content["citation"], list[Citation])


def in_words(entry: Citation) -> str:
    """One line: authors, title, venue, year, note."""
    names = [name.strip("{}") for name in entry.authors]
    who = ", ".join(names) if len(names) < 4 else f"{names[0]} et al"
    when = ", ".join(str(part) for part in (entry.venue, entry.year) if part)
    line = ". ".join(part for part in (who, entry.title, when) if part)
    return f"{line} ({_note(entry)})" if _note(entry) else line


def bibtex(entry: Citation) -> str:
    """The BibTeX entry; accents stay UTF-8."""
    fields = {"author": " and ".join(entry.authors), "title": f"{{{entry.title}}}"}
    if entry.venue:
        fields["journal" if entry.kind == "article" else "booktitle"] = entry.venue
    if entry.year is not None:
        fields["year"] = str(entry.year)
    if note := _note(entry):
        fields["note"] = note
    width = max(map(len, fields))
    lines = [f"  {name:<{width}} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@{entry.kind}{{{entry.key},", *lines, "}"])


def _note(entry: Citation) -> str:
    return f"version {version(OURS)}, {entry.note}" if entry.key == OURS else entry.note
