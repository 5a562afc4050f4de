"""What a batch keeps of each photo: a small JSON file, written when its task has ended.

By what its results were made from the batch knows the photos that are done.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from ..storage.identity import Identity
from ..storage.tables import typed

if TYPE_CHECKING:
    from ..head.model import HeadModel
    from ..settings.settings import Settings


@dataclass(frozen=True)
class BatchRow:
    """One result, or why there is none: a line of the summary table.

    photo: its path. folder: of the result, below the batch's; "" for a photo that failed.
    error: one line, "" for a result. warnings: one line each.
    seconds: by step, with the writing of the files. landmark_residual: mean distance of the fitted
    head from the landmarks, in eye distances. render_psnr: of the re-rendering against the crop
    inside the mask, dB, sRGB-encoded. losses: the last of each stage. report, thumbnail: whether
    the result's folder had these files when it was written.
    """

    photo: str
    folder: str = ""
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    landmark_residual: float | None = None
    render_psnr: float | None = None
    losses: dict[str, float] = field(default_factory=dict)
    report: bool = False
    thumbnail: bool = False


@dataclass(frozen=True)
class Record:
    """The rows of a photo (one per face), and what they were made from.

    identity: None where the photo or the head model could not be read.
    """

    photo: str
    identity: Identity | None
    rows: Annotated[list[BatchRow], Meta(min_length=1)]
    format: Literal[1] = 1

    def results(self, identity: Identity | None) -> dict[str, BatchRow]:
        """The results made from that, by their folders."""
        rows = self.rows if self.identity == identity is not None else []
        return {row.folder: row for row in rows if not row.error}

    def encode(self) -> bytes:
        """The file's content; names that are no text are kept by JSON's escapes."""
        return (json.dumps(asdict(self), indent=1) + "\n").encode()

    @staticmethod
    def decode(content: bytes) -> Record | None:
        """The record in `content`, or None if it is none: its photo then counts as not done."""
        try:
            return typed(json.loads(content), Record)
        except (ValueError, RecursionError):
            return None


def common_identity(settings: Settings, head: HeadModel, face: str | int) -> Identity:
    """What all photos of a batch have in common; face: may be "all"."""
    from ..head.sources.library import model_key
    from ..pipeline.identity import identity_of

    return identity_of("", "", settings, model_key(head), face)


def with_photo(common: Identity, photo: Path) -> Identity | None:
    """The identity of a photo's results; None for a file that cannot be read."""
    try:
        if photo.is_file():  # a pipe would never end
            with photo.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
            return replace(common, photo=photo.name, content=content)
    except (OSError, ValueError):
        pass
    return None
