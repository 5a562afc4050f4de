"""What a batch keeps of each photo: a small JSON file, written when its task has ended."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..head.files import DEFAULT, model_file

#: Version of the file.
FORMAT = 1


@dataclass(frozen=True)
class Row:
    """One result, or why there is none: a line of the summary table.

    photo: its path. folder: of the result, below the batch's; "" for a photo that failed.
    error: one line, "" for a result. warnings: one line each.
    seconds: by step, with the writing of the files. landmark_residual: mean distance of the fitted
    head from the landmarks, in eye distances. render_psnr: of the re-rendering against the crop
    inside the mask, dB, sRGB-encoded. losses: the last of each stage.
    """

    photo: str
    folder: str = ""
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    landmark_residual: float | None = None
    render_psnr: float | None = None
    losses: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """The rows of a photo (one per face), and the key of what they were made from."""

    photo: str
    key: str
    rows: list[Row]

    def results(self, key: str) -> dict[str, Row]:
        """The results made from what `key` stands for, by their folders."""
        rows = self.rows if self.key == key != "" else []
        return {row.folder: row for row in rows if not row.error}

    def encode(self) -> bytes:
        """The file's content; names that are no text are kept by JSON's escapes."""
        values = {"format": FORMAT, **dataclasses.asdict(self)}
        return (json.dumps(values, indent=1) + "\n").encode()

    @staticmethod
    def decode(content: bytes) -> Record | None:
        """The record in `content`, or None if it is none: its photo then counts as not done."""
        try:
            values = json.loads(content)
            rows = [_row(row) for row in values["rows"]]
            if values["format"] != FORMAT or not rows:
                return None
            return Record(_of(str, values["photo"]), _of(str, values["key"]), rows)
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            return None


def content_key(photo: Path, settings: dict[str, Any], face: str | int) -> str:
    """Changes with what a result is made from: photo, settings, head, face, unlit's version.

    "" for a photo or head model that cannot be read, of which there is no result.
    """
    model = model_file(str(settings.get("head_model", DEFAULT)))
    contents = []
    try:
        for path in (photo, *([model] if model else [])):
            if not path.is_file():  # a pipe would never end
                return ""
            with path.open("rb") as file:
                contents.append(hashlib.file_digest(file, "sha256").hexdigest())
    except (OSError, ValueError):
        return ""
    parts = [*contents, settings, face, version("unlit")]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def readable(text: str) -> str:
    """`text` that a table or terminal takes: names may hold control characters, or no text."""
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in text)


def _row(values: dict[str, Any]) -> Row:
    return Row(
        photo=_of(str, values["photo"]),
        folder=_of(str, values["folder"]),
        error=_of(str, values["error"]),
        warnings=[_of(str, line) for line in _of(list, values["warnings"])],
        seconds=_numbers(values["seconds"]),
        landmark_residual=_number_or_none(values["landmark_residual"]),
        render_psnr=_number_or_none(values["render_psnr"]),
        losses=_numbers(values["losses"]),
    )


def _numbers(values: Any) -> dict[str, float]:
    return {name: float(value) for name, value in _of(dict, values).items()}


def _number_or_none(value: Any) -> float | None:
    return None if value is None else float(value)


def _of(kind: type, value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"{value!r} is no {kind.__name__}")
    return value
