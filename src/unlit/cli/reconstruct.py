"""`unlit reconstruct`: a photo to a folder of maps, mesh and light."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from . import models
from .parser import command
from .settings import add_settings, settings_of


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "reconstruct",
        run,
        "a photo to a folder of maps, mesh and light",
        "Reconstruct the face in PHOTO (JPEG, PNG, TIFF, WebP, HEIC) into the folder DIR. While "
        "it runs, DIR/unlit-preview.png shows the state after each stage; all results come at the "
        "end, at once. An older result in DIR is replaced.",
        "  unlit reconstruct portrait.jpg -o portrait\n"
        "  unlit reconstruct group.jpg -o second --face 1 --preset draft\n"
        "  unlit reconstruct portrait.jpg -o again --config portrait/reconstruction.toml \\\n"
        "      --set stage2.iterations=500",
    )
    parser.add_argument("photo", metavar="PHOTO", help="the picture file")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write")
    add_settings(parser, "paper")


def run(options: argparse.Namespace) -> int:
    from ..photo import read_photo

    return reconstruct_into(lambda: read_photo(options.photo), options)


def reconstruct_into(read: Any, options: argparse.Namespace) -> int:
    """Read the photo, reconstruct it, save it: shared by `reconstruct` and `demo`."""
    from ..console import RunConsole, settings_block

    settings = settings_of(options)
    from ..optimize.schedule import as_dict
    from ..output import FILES, needed_bytes, preview_png, reserve, save, write_one

    plain = as_dict(settings)
    stages = {name: value["iterations"] for name, value in plain.items() if isinstance(value, dict)}
    folder = Path(options.output)
    with reserve(folder, FILES, needed_bytes(settings.resolution)) as preview:
        photo = read()
        models.fetch("reconstruct")
        from ..pipeline import reconstruct

        with RunConsole(stages) as console:
            height, width = photo.pixels.shape[:2]
            console.say(f"photo     {photo.source}, {width} x {height}, {photo.colours}")
            console.say(f"preset    {options.preset}")
            for line in settings_block(plain):
                console.say(line)
            console.say(f"preview   {preview}")
            result = reconstruct(
                photo,
                settings=settings,
                face=options.face,
                progress=console,
                preview=lambda _, state: write_one(preview, preview_png(state)),
            )
            for name, value in result.metrics.items():
                if isinstance(value, int | float):
                    console.say(f"{name}  {value:.4g}")
            save(result, folder, console.log())
    print(folder / "montage.png")
    return 0
