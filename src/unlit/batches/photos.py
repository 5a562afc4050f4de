"""Which photos a command's inputs name, and what each one's result is called."""

from __future__ import annotations

import glob
import hashlib
import os
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from ..errors import PhotoError
from ..storage.folder import MARK

#: What counts as a photo in a folder or glob; a file named by itself may be called anything.
SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".heic", ".heif", ".avif", ".jxl")
#: Bytes of a result's name in UTF-8: file systems allow 255, and a suffix may be added.
_LONGEST = 100
_WINDOWS = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def find_photos(inputs: Iterable[str]) -> list[Path]:
    """The photos that files, folders and globs name: absolute paths, each once, in a fixed order.

    Folders are searched to any depth, but not through links, nor in hidden folders and the
    folders of results; a picture that links give several names counts once. Raises PhotoError for
    an input that names no photo.
    """
    found: dict[str, Path] = {}
    for name in inputs:
        photos = list(_photos_of(name))
        if not photos:
            raise PhotoError(
                f"{name}: no photo there; give picture files, folders of them or globs in quotes"
            )
        for photo in photos:
            # Through links one picture may have many names; `**` follows them.
            found.setdefault(os.path.realpath(photo), Path(os.path.abspath(photo)))  # noqa: PTH100
    return list(found.values())


def _photos_of(name: str) -> Iterator[str]:
    if Path(name).is_file():
        yield name
        return
    found = [name] if Path(name).is_dir() else glob.glob(name, recursive=True)  # noqa: PTH207
    for place in sorted(found):
        if Path(place).is_dir():
            yield from _below(place)
        elif place.lower().endswith(SUFFIXES) and not _in_a_result(Path(place)):
            yield place


def _in_a_result(file: Path) -> bool:
    return any((folder / MARK).exists() for folder in file.parents)


def _below(folder: str) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        if MARK in files:
            folders.clear()
            continue
        folders[:] = sorted(inner for inner in folders if not inner.startswith("."))
        for file in sorted(files):
            if file.lower().endswith(SUFFIXES) and not file.startswith("."):
                yield os.path.join(place, file)  # noqa: PTH118


def name_results(
    photos: Iterable[Path], owners: Mapping[str, str], reserved: Collection[str]
) -> dict[Path, str]:
    """A name for each photo's result, from the photo's own.

    owners: names that were given in earlier runs, with the photos (paths) that have them; these
    stay. reserved: names that nobody gets. A name that is taken (in any case of its letters) is
    told apart by eight digits of the path's hash, so that it does not depend on the order.
    """
    given = {photo: name for name, photo in owners.items()}
    taken = {name.casefold() for name in (*owners, *reserved)}
    names: dict[Path, str] = {}
    for photo in photos:
        name = given.get(str(photo)) or safe_name(photo.stem)
        if str(photo) not in given and name.casefold() in taken:
            digest = hashlib.sha256(os.fsencode(photo)).hexdigest()
            name = f"{name}-{digest[:8]}"
        taken.add(name.casefold())
        names[photo] = name
    return names


def safe_name(stem: str) -> str:
    """`stem` as one visible path component that every file system and shell takes as it is.

    Letters of any script, digits, and ``_ - . ( )`` and blanks between them stay; everything else
    (separators, control and formatting characters, bytes that are no text) becomes ``_``.
    """
    text = unicodedata.normalize("NFC", stem)
    text = "".join(
        char if char in "_-.() " or unicodedata.category(char)[0] in "LMN" else "_" for char in text
    )
    text = text.encode()[:_LONGEST].decode(errors="ignore").lstrip(" .-").rstrip(" .")
    if not text.strip("_"):
        return "photo"
    return f"photo {text}" if _WINDOWS.fullmatch(text) else text
