"""What a batch keeps of each photo: a small JSON file, written when its task has ended."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any

import msgspec

from ..storage.identity import Identity

#: Version of the file.
FORMAT = 1


@dataclass(frozen=True)
class BatchRow:
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
    """The rows of a photo (one per face), and what they were made from.

    identity: None where the photo or the head model could not be read.
    """

    photo: str
    identity: Identity | None
    rows: list[BatchRow]

    def results(self, identity: Identity | None) -> dict[str, BatchRow]:
        """The results made from that, by their folders."""
        rows = self.rows if self.identity == identity is not None else []
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
            made_from = values["identity"]
            identity = None if made_from is None else msgspec.convert(made_from, Identity)
            return Record(_of(str, values["photo"]), identity, rows)
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            return None


def readable(text: str) -> str:
    """`text` that a table or terminal takes: names may hold control characters, or no text."""
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in text)


def _row(values: dict[str, Any]) -> BatchRow:
    return BatchRow(
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
