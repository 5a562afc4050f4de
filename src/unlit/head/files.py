"""Where head models are kept: the names of those that a user has added, and their files."""

from __future__ import annotations

import os
from pathlib import Path

from ..machine.assets import FOLDER_VARIABLE
from ..machine.user_folders import expanded, user_data

#: The head model that every installation has.
DEFAULT = "makehuman"
SUFFIX = ".npz"


def models_folder() -> Path:
    """Where added models are kept: data of the user's that no cleaning of caches removes."""
    return user_data() / "heads"


def added() -> dict[str, Path]:
    """Models by name, in the folder that UNLIT_MODELS names and in the user's own."""
    named = os.environ.get(FOLDER_VARIABLE)
    places = [models_folder(), *([expanded(named)] if named else [])]
    return {path.stem: path for place in places for path in sorted(place.glob(f"*{SUFFIX}"))}


def model_file(name: str) -> Path | None:
    """Where the model `name` is kept; None for the default, and for a name that none has."""
    return expanded(name) if name.endswith(SUFFIX) else added().get(name)
