"""The user's own folders: for what can be had again, and for what the user has added."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import platformdirs

from ..errors import MachineError


def user_cache() -> Path:
    """Folder for what can be fetched or built again; it need not exist. Raises MachineError."""
    return _known(platformdirs.user_cache_path)


def user_data() -> Path:
    """Folder for what no cleaning of caches may remove; it need not exist. Raises MachineError."""
    return _known(platformdirs.user_data_path)


def _known(folder_of: Callable[..., Path]) -> Path:
    try:
        folder = folder_of("unlit", appauthor=False)
    except RuntimeError:  # some versions of platformdirs; others leave the "~" in
        folder = Path("~")
    if not folder.is_absolute():
        raise MachineError(
            "the user's home folder is not known: set HOME, or both XDG_CACHE_HOME and "
            "XDG_DATA_HOME, to a folder that can be written"
        )
    return folder


def expanded(name: str) -> Path:
    """The path `name` with the user's home for a leading "~", which stays where none is known."""
    return Path(os.path.expanduser(name))  # noqa: PTH111 (pathlib's raises where none is known)
