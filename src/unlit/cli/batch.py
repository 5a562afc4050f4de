"""`unlit batch`: many photos, each to a folder of its own."""

from __future__ import annotations

import argparse
from typing import Any

from . import models
from .arguments import user_path
from .parser import command
from .settings import add_settings, settings_of


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "batch",
        run,
        "many photos, on all cores or a cluster, each to a folder of its own",
        "Reconstruct every photo that the INPUTs name (files, folders, globs in quotes) into "
        "DIR/NAME, skip what is done, and sum up times, residuals, warnings and errors in "
        "DIR/batch.csv, .html and .parquet. A photo that fails does not stop the others. "
        "Interrupt it at any time: the same call goes on. Needs `pip install 'unlit[batch]'`; "
        "docs/batch.md.",
        "  unlit batch photos -o results\n"
        "  unlit batch 'shoot/**/*.jpg' portrait.png -o results --preset draft --face largest\n"
        "  unlit batch /shared/photos -o s3://bucket/results --scheduler tcp://10.0.0.5:8786",
    )
    parser.add_argument(
        "inputs", type=user_path, metavar="INPUT", nargs="+", help="a photo, a folder, or a glob"
    )
    parser.add_argument(
        *("-o", "--output"),
        type=user_path,
        metavar="DIR",
        required=True,
        help="folder or URL to write to",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask cluster, as tcp://HOST:8786; without it, workers on this machine",
    )
    add_settings(parser, "standard", every_face=True)


def run(options: argparse.Namespace) -> int:
    from ..batches import require_extra

    require_extra()
    from ..batches.folder import BatchFolder
    from ..batches.photos import find_photos
    from ..batches.run import run_batch
    from ..head.sources.library import head_model
    from .batch_console import BatchConsole

    settings, folder = settings_of(options), options.output
    photos = find_photos(options.inputs)
    if options.scheduler is None:
        models.fetch("reconstruct")
        head_model(settings.head_model)  # tells now, not once for each photo, if there is none
    with BatchConsole() as watch:
        rows = run_batch(
            photos, folder, settings, options.face, options.scheduler, watch, options.memory
        )
    print(BatchFolder(folder).link("batch.html"))
    return int(any(row.error for row in rows))
