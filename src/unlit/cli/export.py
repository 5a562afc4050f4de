"""`unlit export`: a saved result for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .answer import add_json, answer
from .arguments import user_path
from .parser import command

#: Kept here, too, so that the help does not wait for the renderer.
LAYOUTS = ("face", "head")
SCALPS = ("skin", "hair")
POSES = ("photo", "neutral")
EXPORTS = ("glb", "obj", "ply", "mitsuba", "blender")
MAPS = (
    *("diffuse_albedo", "specular_albedo", "roughness"),
    *("specular_normal", "diffuse_normal", "displacement", "confidence"),
)


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
        "  unlit export portrait -o rig --format glb --pose neutral\n"
        "  unlit export portrait -o unreal --format glb,obj --size 2048 --directx\n"
        "  unlit export portrait -o maps --only-maps diffuse_albedo,roughness --size 4096",
    )
    parser.add_argument(
        "folder", type=user_path, metavar="DIR", help="a folder that `unlit reconstruct` wrote"
    )
    parser.add_argument(
        *("-o", "--output"), type=user_path, metavar="OUT", help="folder to write (DIR/export)"
    )
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument(
        "--format",
        type=lambda text: text.split(","),
        metavar="LIST",
        help=f"of {', '.join(EXPORTS)}, usd ({','.join(EXPORTS)}; without the last two where the "
        "pose is neutral)",
    )
    kinds.add_argument(
        "--only-maps",
        type=lambda text: text.split(","),
        default=[],
        metavar="LIST",
        help=f"only these maps, as PNG and EXR: of {', '.join(MAPS)}",
    )
    parser.add_argument(
        "--size",
        type=int,
        metavar="N",
        help="texels a side, 512 to 4096 (twice the crop's pixels: 1024 at 512)",
    )
    parser.add_argument(
        "--layout",
        choices=LAYOUTS,
        default=LAYOUTS[0],
        help="texture coordinates: most of the square for the face (the default), or as the head "
        "model has them",
    )
    parser.add_argument(
        "--scalp",
        choices=SCALPS,
        default=SCALPS[0],
        help="what lies under hair: the person's skin (the default), or the hair's mean colour",
    )
    parser.add_argument(
        "--pose",
        choices=POSES,
        default=POSES[0],
        help="the head as the photo shows it (the default), or neutral: upright, looking ahead, "
        "without an expression or a camera, to be animated",
    )
    parser.add_argument(
        "--directx", action="store_true", help="normal maps (PNG) with y down, as Unreal wants"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from ..output.export import export, listed
    from ..output.load import load
    from ..progress.console import StepConsole

    source = Path(options.folder)
    target = Path(options.output) if options.output else source / "export"
    with StepConsole() as progress:
        path = export(
            load(source),
            target,
            source,
            options.format,
            options.size,
            options.directx,
            progress,
            only_maps=options.only_maps,
            layout=options.layout,
            scalp=options.scalp,
            pose=options.pose,
        )
    answer(options, path, folder=path, files=[path / name for name in listed(path)])
    return 0
