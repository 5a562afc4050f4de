"""Options that set how a reconstruction is done, shared by several commands."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import get_args

from ..errors import SettingsError
from ..machine import cost
from ..settings.conditions import CastShadowMode
from ..settings.ranges import is_table
from ..settings.settings import PRESETS, Settings, override
from ..settings.sun import SunMode
from .arguments import user_path

#: Fields of a saved result's reconstruction.toml (output/result_file.py).
_BESIDE = {"format", "unlit", "photo", "camera", "crop", "light", "settings", "files"}
#: Options whose text is the value of a setting.
_SETTINGS = {
    "resolution": "resolution",
    "model": "head_model",
    "light_color": "light_color",
    "exposure": "exposure",
    "cast_shadows": "cast_shadow.mode",
    "sun": "sun.mode",
}


def add_settings(parser: argparse.ArgumentParser, preset: str, every_face: bool = False) -> None:
    """Add the options; with `every_face`, --face takes "all", too."""
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        default=preset,
        help="standard: our schedule, 512 pixels; draft: the same at 256, a quick look; paper: "
        f"Table 1 of the paper as printed, 5,350 iterations at 512 ({preset})",
    )
    parser.add_argument(
        "--resolution", type=int, metavar="N", help="side of the face crop, 256 to 2048 pixels"
    )
    parser.add_argument(
        "--memory",
        type=_memory,
        metavar="SIZE",
        help="refuse to begin what takes more, e.g. 4GB; "
        f"512 pixels a side take {_gigabytes(512)}, 2048 take {_gigabytes(2048)}; "
        "in a batch, what its workers on this machine take together",
    )
    parser.add_argument(
        "--model",
        type=user_path,
        metavar="NAME",
        help="head model to fit: makehuman (default), ict once added by `unlit models add`, or an "
        ".npz file of docs/head-model-format.md",
    )
    _add_conditions(parser)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=_assignment,
        metavar="NAME=VALUE",
        help="override one setting, e.g. stage2.iterations=500; may be repeated",
    )
    parser.add_argument(
        "--config",
        type=user_path,
        metavar="FILE.toml",
        help="settings from a TOML file, or those of an older result's reconstruction.toml",
    )
    _add_face(parser, every_face)


def _add_conditions(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--light-color",
        metavar="COLOR",
        help="of the photo's light, which is taken for white: a grey card's pixel X,Y in the "
        "photo; a temperature, 1700K to 25000K; R,G,B (linear) or '#rrggbb' of something white or "
        "grey in that light; or auto, an estimate from the gloss of the skin",
    )
    parser.add_argument(
        "--exposure",
        metavar="KNOWN",
        help="fix the gain that albedo and light share by what you know: X,Y=ALBEDO of a pixel of "
        "the photo, skin=ALBEDO of the whole skin, or the light measured at the face, as 500lux; "
        "without it a white card in full light would be 1.4 times as bright as the photo's white",
    )
    parser.add_argument(
        "--sun",
        choices=get_args(SunMode),
        help="auto (default): where the photo has one small hard light, as the sun or a lamp, its "
        "shadow is taken out of the photo before the maps are made; always: whatever the evidence; "
        "never",
    )
    parser.add_argument(
        "--cast-shadows",
        choices=get_args(CastShadowMode),
        help="auto (default): where no sun was found, but hair, a hat or a hand seems to cast a "
        "shadow on the face, it is taken out of the photo; keep: take the photo as it is",
    )


def _add_face(parser: argparse.ArgumentParser, every_face: bool) -> None:
    parser.add_argument(
        "--face",
        type=lambda text: text if every_face and text == "all" else _face(text),
        default="only",
        metavar="largest|left|right|N|all" if every_face else "largest|left|right|N",
        help="which face if there are several: the largest, the one furthest left or right in the "
        "picture, "
        + ("all (in folders face0, face1, ...), " if every_face else "")
        + "or a number from 0, large to small",
    )


def settings_of(options: argparse.Namespace) -> Settings:
    """Preset, then --config, then the options with names of settings, then --set."""
    settings = PRESETS[options.preset]
    if options.config is not None:
        settings = _configured(settings, Path(options.config))
    named = {name: getattr(options, option) for option, name in _SETTINGS.items()}
    settings = override(settings, {name: said for name, said in named.items() if said is not None})
    settings = override(settings, assigned(options))
    if settings.head_model.endswith(".npz"):
        # A worker or a later run may have another working directory.
        file = Path(user_path(settings.head_model)).resolve()
        settings = replace(settings, head_model=str(file))
    if options.memory is not None:
        cost.check_memory(options.memory, settings.resolution)
    return settings


def assigned(options: argparse.Namespace) -> dict[str, str]:
    """What --set says, by name. Raises SettingsError for a name that is said twice."""
    found: dict[str, str] = {}
    for name, value in options.set:
        if name in found:
            raise SettingsError(f"--set {name}: given twice; give it once")
        found[name] = value
    return found


def _configured(settings: Settings, path: Path) -> Settings:
    """`settings` with those of a TOML file, at its top level or as a saved result has them.

    Raises SettingsError that names the line.
    """
    from ..storage.tables import place_of, read_toml

    values = read_toml(path, SettingsError)
    inner = values.get("settings", values)
    if not is_table(inner):
        raise SettingsError(f"{path}: settings must be a table")
    prefix = "" if inner is values else "settings."
    for name in values.keys() - _BESIDE if prefix else ():
        raise SettingsError(
            f"{place_of(path, name)}: {name}: settings stand below [settings], and this is none of "
            "the other fields of a result; move or remove it"
        )
    try:
        return override(settings, inner)
    except SettingsError as error:
        place = place_of(path, prefix + error.argument)
        raise SettingsError(f"{place}: {error}") from error


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r}: write NAME=VALUE")
    return name.strip(), value.strip()


def _gigabytes(resolution: int) -> str:
    return f"{cost.memory(resolution) / 1e9:.1f} GB"


def _memory(text: str) -> float:
    try:
        return cost.read_size(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: write a size as 4GB or 900MB") from error


def _face(text: str) -> str | int:
    if text in ("largest", "left", "right", "only"):
        return text
    if text.isdecimal():
        return int(text)
    if text == "all":
        raise argparse.ArgumentTypeError("all faces of a photo are what `unlit batch` can do")
    raise argparse.ArgumentTypeError(f"{text!r}: write largest, left, right, or a number from 0")
