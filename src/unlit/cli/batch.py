"""`unlit batch`: many photos, each to a folder of its own."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from . import models
from .answer import add_json, answer
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
        "DIR/batch.html, a gallery with a link to each report, .csv and .parquet. A photo that "
        "fails does not stop the others. Interrupt it at any time: the same call goes on. Needs "
        "`pip install 'unlit[batch]'`; docs/batch.md.",
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
    parser.add_argument(
        "--no-reports",
        action="store_true",
        help="do without each result's report.html, which takes some seconds and 3 MB; "
        "`unlit report` writes it later",
    )
    parser.add_argument(
        "--dashboard",
        action="store_true",
        help="print the address of Dask's dashboard, which shows what the workers do; needs "
        "`pip install 'unlit[batch,dashboard]'`",
    )
    add_settings(parser, "standard", every_face=True)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from ..batches import require_extra

    require_extra(options.dashboard)
    from ..batches.folder import BatchFolder
    from ..batches.photos import find_photos
    from ..batches.run import BatchRequest, run_batch
    from ..head.sources.library import head_model
    from .batch_console import BatchConsole

    settings, folder = settings_of(options), options.output
    photos = find_photos(options.inputs)
    if options.scheduler is None:
        models.fetch("reconstruct")
        head_model(settings.head_model)  # tells now, not once for each photo, if there is none
    request = BatchRequest(
        photos,
        folder,
        settings,
        face=options.face,
        scheduler=options.scheduler,
        memory=options.memory,
        reports=not options.no_reports,
        dashboard=options.dashboard,
    )
    with BatchConsole() as watch:
        rows = run_batch(request, watch)
    page, failed = BatchFolder(folder).link("batch.html"), sum(bool(row.error) for row in rows)
    done = len(rows) - failed
    answer(options, page, page=page, done=done, failed=failed, rows=[asdict(row) for row in rows])
    return int(failed > 0)
