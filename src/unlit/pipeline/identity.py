"""The identity of a result that is to be made (storage/identity.py)."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from ..machine.runtime import mitsuba
from ..perception.landmarks import DetectedFace
from ..photo.photo import Photo
from ..settings.settings import Settings, as_dict, flat
from ..storage.identity import Identity
from ..storage.keys import RECONSTRUCTION, code, key


def identity_of(
    photo: str,
    content: str,
    settings: Settings,
    head: str,
    face: str | int | DetectedFace,
    mask: np.ndarray | None = None,
) -> Identity:
    """Of a result of this code and renderer.

    photo: its name. content: `photo_content`, or the file's hash. head: `model_key` of the head
    model. face, mask: as for `observe`.
    """
    mi = mitsuba()
    return Identity(
        photo,
        content,
        key(face.landmarks) if isinstance(face, DetectedFace) else str(face),
        "" if mask is None else key(mask),
        {name: str(value) for name, value in flat(as_dict(settings)).items()},
        head,
        version("unlit"),
        code(RECONSTRUCTION),
        f"{mi.variant()} {mi.__version__}",
    )


def photo_content(photo: Photo) -> str:
    """Key of a photo's pixels and of what its file tells of camera and exposure."""
    return key(photo.pixels, photo.focal, photo.white_luminance)
