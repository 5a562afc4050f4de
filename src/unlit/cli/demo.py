"""`unlit demo`: the main job on a photo that everyone has."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from .answer import add_json
from .arguments import user_path
from .parser import command
from .reconstruct import reconstruct_into
from .settings import add_settings

if TYPE_CHECKING:
    from ..photo.photo import Photo

_FOLDER = "unlit-demo"


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "demo",
        run,
        "try it on a photo that comes with scikit-image",
        "Reconstruct the astronaut Eileen Collins (public domain, comes with scikit-image).",
        "  unlit demo\n  unlit demo -o astronaut --preset standard",
    )
    parser.add_argument(
        *("-o", "--output"), type=user_path, metavar="DIR", default=_FOLDER, help=f"({_FOLDER})"
    )
    add_settings(parser, "draft")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    def astronaut() -> Photo:
        from skimage.data import astronaut

        from ..photo.photo import Photo

        return Photo.of(astronaut(), "astronaut.png")  # pyright: ignore[reportUnknownArgumentType]

    return reconstruct_into(astronaut, options)
