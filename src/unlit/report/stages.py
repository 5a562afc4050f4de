"""What each stage changed: small pictures kept beside a result, in `stages.zip`.

`unlit reconstruct` takes them from the state that the pipeline shows after the fit and after each
stage. A result without them (saved from Python, or by an older unlit) has a report without them.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path

from ..errors import OutputError
from ..face.reconstruction import Reconstruction
from ..output.images import encoded, normals, webp
from ..storage.arrays import DAMAGED
from ..storage.folder import STAGES

#: In order, for each state: its name, and WebP files by kind ("render", "albedo", "normals").
Stages = list[tuple[str, dict[str, bytes]]]

_LARGEST = 512  # pixels a side
_NAME = re.compile(r"\d\d-(fit|stage[1-5])/(render|albedo|normals)\.webp")
_MOST_FILES = 18
_MOST_BYTES = 4 << 20  # each
_REMEDY = "reconstruct the photo again, or remove it"


def stage_pictures(state: Reconstruction) -> dict[str, bytes]:
    """The state's pictures by kind; no render where nothing is shaded yet, after the fit."""
    inside = (state.face.mask > 0)[..., None]
    found = {
        "albedo": webp(encoded(state.face.maps.diffuse_albedo * inside), _LARGEST),
        "normals": webp(normals(state.face.normals.specular * inside), _LARGEST),
    }
    if state.images.render.any():
        found["render"] = webp(encoded(state.images.render), _LARGEST)
    return found


def pack_stages(stages: Stages) -> bytes:
    """The content of stages.zip: NN-stage/kind.webp, the same bytes for the same pictures."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:  # stored: WebP does not shrink
        for number, (stage, pictures) in enumerate(stages):
            for kind, content in pictures.items():
                archive.writestr(zipfile.ZipInfo(f"{number:02}-{stage}/{kind}.webp"), content)
    return stream.getvalue()


def read_stages(folder: Path) -> Stages:
    """The stages' pictures in a result's folder; empty where it has none. Raises OutputError."""
    path = folder / STAGES
    try:
        with zipfile.ZipFile(path) as archive:
            return _grouped(archive, sorted(archive.namelist()))
    except FileNotFoundError:
        return []
    except DAMAGED as error:
        raise OutputError(f"{path}: damaged or not unlit's ({error}); {_REMEDY}") from error


def _grouped(archive: zipfile.ZipFile, names: Iterable[str]) -> Stages:
    found: dict[str, dict[str, bytes]] = {}
    for number, name in enumerate(names):
        match = _NAME.fullmatch(name)
        size = archive.getinfo(name).file_size
        if match is None or number >= _MOST_FILES or size > _MOST_BYTES:
            raise ValueError(f"unexpected entry {name!r}")
        with archive.open(name) as member:
            content = member.read(_MOST_BYTES + 1)
        if content[:4] != b"RIFF" or content[8:12] != b"WEBP" or len(content) > _MOST_BYTES:
            raise ValueError(f"{name} is no WebP picture")
        found.setdefault(match[1], {})[match[2]] = content
    return list(found.items())
