"""`unlit export`: a saved result for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .parser import command

#: Kept here, too, so that the help does not wait for the renderer.
EXPORTS = ("glb", "obj", "ply", "mitsuba", "blender")


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "export",
        run,
        "write a result for Blender, Mitsuba, game engines and viewers",
        "Bake the maps of the result in DIR to the mesh's texture coordinates and write them with "
        "the mesh, light and camera (docs/outputs.md). Prints the folder written.",
        "  unlit export portrait\n"
        "  unlit export portrait -o unreal --format glb,obj --size 2048 --directx",
    )
    parser.add_argument("folder", metavar="DIR", help="a folder that `unlit reconstruct` wrote")
    parser.add_argument("-o", "--output", metavar="OUT", help="folder to write (DIR/export)")
    parser.add_argument(
        "--format",
        type=lambda text: text.split(","),
        default=list(EXPORTS),
        metavar="LIST",
        help=f"of {', '.join(EXPORTS)}, usd ({','.join(EXPORTS)})",
    )
    parser.add_argument(
        "--size", type=int, default=1024, metavar="N", help="texels a side, 512 to 4096 (1024)"
    )
    parser.add_argument(
        "--directx", action="store_true", help="normal maps (PNG) with y down, as Unreal wants"
    )


def run(options: argparse.Namespace) -> int:
    from ..console import StepConsole
    from ..output import export, load

    source = Path(options.folder)
    target = Path(options.output) if options.output else source / "export"
    size, directx, progress = options.size, options.directx, StepConsole()
    print(export(load(source), target, source, options.format, size, directx, progress))
    return 0
