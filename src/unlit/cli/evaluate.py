"""`unlit evaluate`: measure the method where the truth is known."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import SettingsError
from . import models
from .arguments import user_path
from .parser import command, refuse_unused, whole_number
from .settings import add_settings, settings_of


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "evaluate",
        run,
        "measure the method on a subject whose truth is known",
        "Photograph a scanned head under known lights, reconstruct it from each photo, relight it "
        "by the others and compare: the paper's Tables 2 and 3. SUBJECT is a subject.toml or its "
        "folder (docs/evaluation.md). Finished steps stay in DIR/steps and are not repeated.",
        "  unlit evaluate scan/subject.toml -o scan-check --check\n"
        "  unlit evaluate scan -o results --lights flash,uniform,side --ablation\n"
        "  unlit evaluate --same-person noon.jpg window.jpg lamp.jpg -o alike",
    )
    parser.add_argument(
        "inputs", type=user_path, metavar="SUBJECT", nargs="+", help="or photos of one person"
    )
    parser.add_argument(
        *("-o", "--output"), type=user_path, metavar="DIR", required=True, help="folder to write"
    )
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument("--check", action="store_true", help="only render it under three lights")
    kinds.add_argument("--ablation", action="store_true", help="also switch each stage off")
    kinds.add_argument(
        "--same-person", action="store_true", help="photos of one person: compare their albedos"
    )
    parser.add_argument(
        "--lights",
        metavar="LIST",
        help="of flash, uniform, side, and .hdr or .exr files (flash,uniform)",
    )
    samples, seed = whole_number(1, 65536), whole_number(0, 999_999)
    parser.add_argument(
        "--samples", type=samples, metavar="N", help="of the path tracer, per pixel (256)"
    )
    parser.add_argument(
        "--true-mesh", action="store_true", help="give the reconstruction the subject's own mesh"
    )
    parser.add_argument("--seed", type=seed, metavar="N", help="of the path tracer's samples (0)")
    add_settings(parser, "standard")


def run(options: argparse.Namespace) -> int:
    settings = settings_of(options)
    from ..evaluate import command
    from ..head.sources.library import head_model
    from ..machine import cost
    from ..progress.console import StudyConsole

    inputs, folder = [Path(name) for name in options.inputs], Path(options.output)
    if not options.same_person and len(inputs) != 1:
        raise SettingsError("evaluate one subject at a time, or photos with --same-person")
    of_protocol = ("lights", "samples", "seed", "true_mesh")
    if options.same_person:
        refuse_unused(options, of_protocol, "--same-person")
    elif options.check:
        refuse_unused(options, (*of_protocol, "face", "model"), "--check")
    else:
        refuse_unused(options, ("face",), "a subject")
    # LPIPS compares relit pictures, which only the whole protocol makes.
    whole = not (options.same_person or options.check)
    models.fetch("reconstruct", *(["evaluate"] if whole else []))
    plan = cost.plan(settings.resolution, settings.iterations(), cost.cores(), settings.solver)
    watch = StudyConsole(plan)
    head_model(settings.head_model)  # tells now, not after the photos, if there is none
    if options.check:
        print(command.run_check(inputs[0], folder, settings, watch))
        return 0
    if options.same_person:
        path = command.run_persons(inputs, folder, settings, options.face, watch)
    else:
        lights = (options.lights or "flash,uniform").split(",")
        protocol = command.EvaluationPlan(
            lights,
            options.samples or 256,
            options.seed or 0,
            options.ablation,
            options.true_mesh,
        )
        path = command.run_subject(inputs[0], folder, settings, protocol, watch)
    print(path.read_text())
    print(path)
    return 0
