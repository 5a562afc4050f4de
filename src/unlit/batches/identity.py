"""What the results of a batch are made from, by which it knows the photos that are done."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..storage.identity import Identity

if TYPE_CHECKING:
    from ..head.model import HeadModel
    from ..settings.settings import Settings


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
