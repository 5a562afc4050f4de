"""`unlit relight`: a saved result under another light."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from .answer import add_json, answer
from .arguments import user_path
from .parser import command


def add(commands: Any) -> None:
    """The sub-parser of this command."""
    parser = command(
        commands,
        "relight",
        run,
        "a result under another light, as a picture or a video",
        "Render the face in DIR, a folder that `unlit reconstruct` wrote, under another light: "
        "path-traced, or with --fast in a second or two. The ending of FILE says what is made: "
        ".png or .jpg (sRGB), .exr (linear), or a video, .mp4, .gif or numbered pictures such as "
        "out_%04d.png, in which the light turns once round the head, or with --turntable the head "
        "turns. With --over-photo the whole person is relit in the photo. More: "
        "docs/relighting.md.",
        "  unlit relight portrait --light flash -o flash.png\n"
        "  unlit relight portrait --light sun:-60,30 --over-photo portrait.jpg -o sun.png\n"
        "  unlit relight portrait --light side --over-photo portrait.jpg --background '#808080' "
        "-o grey.jpg\n"
        "  unlit relight portrait --light side --passes side.exr\n"
        "  unlit relight portrait --light studio.hdr --rotate 90 --brightness 0.5 -o studio.exr\n"
        "  unlit relight portrait --light sun:0,20 --fast -o sweep.mp4\n"
        "  unlit relight portrait --light photo --turntable --fast -o turn.gif",
    )
    parser.add_argument(
        "folder", type=user_path, metavar="DIR", help="a folder that `unlit reconstruct` wrote"
    )
    _add_light(parser)
    _add_picture(parser)
    add_json(parser)


def _add_light(parser: argparse.ArgumentParser) -> None:
    """Options of the light and of what moves."""
    parser.add_argument(
        "--light",
        type=user_path,
        metavar="LIGHT",
        required=True,
        help="flash (from the camera), uniform, side (60 degrees from the right), "
        "sun:AZIMUTH,ELEVATION (degrees; 0,0 from the camera, 90,0 from the picture's right), "
        "photo (the reconstructed light), or an .hdr or .exr latitude-longitude map",
    )
    parser.add_argument(
        "--rotate",
        type=_angle,
        metavar="DEG|sweep",
        help="DEG: turn the light by so much about the vertical axis, from the camera towards the "
        "picture's right; sweep: once round, which makes a video (and is what a video shows if "
        "nothing else is asked for)",
    )
    parser.add_argument(
        "--turntable",
        nargs="?",
        type=float,
        const=35.0,
        metavar="DEG",
        help="video: turn the head DEG degrees (35) to either side, or with 360 once round; the "
        "light stands still",
    )
    parser.add_argument(
        "--brightness",
        type=float,
        default=0.0,
        metavar="STOPS",
        help="1 doubles the light, -1 halves it (0)",
    )


def _add_picture(parser: argparse.ArgumentParser) -> None:
    """Options of the file that is written."""
    parser.add_argument(
        *("-o", "--output"),
        type=user_path,
        metavar="FILE",
        help=".png, .jpg, .exr, .mp4, .gif, or numbered pictures, out_%%04d.png",
    )
    parser.add_argument(
        "--over-photo",
        type=_file,
        metavar="PHOTO",
        help="relight the whole person in the photo that the result was made from, at full size: "
        "skin by the model, hair and clothes by new over old shading",
    )
    parser.add_argument(
        "--background",
        type=user_path,
        metavar="WHAT",
        help="with --over-photo, behind the person: photo (as it is), light (the new light as the "
        "camera sees it), a colour ('#808080', navy), or a picture file, scaled to fill",
    )
    parser.add_argument(
        "--passes",
        type=_file,
        metavar="FILE",
        help="write an .exr of layers for compositing (diffuse, specular, visibility, normal, "
        "depth ...), with --over-photo in the photo's frame; -o may then be left out",
    )
    parser.add_argument(
        "--fast", action="store_true", help="deterministic transport renderer instead of paths"
    )
    parser.add_argument(
        "--samples", type=int, metavar="N", help="paths per pixel (128; 32 in a video)"
    )
    parser.add_argument("--frames", type=int, metavar="N", help="of a video (75)")
    parser.add_argument("--fps", type=int, metavar="N", help="frames a second of a video (25)")


def _file(text: str) -> Path:
    return Path(user_path(text))


def _angle(text: str) -> float | str:
    return text if text == "sweep" else float(text)


def run(options: argparse.Namespace) -> int:
    from ..progress.console import StepConsole
    from ..relighting.command import RelightRequest, relight

    asked = {name: getattr(options, name) for name in RelightRequest.__dataclass_fields__}
    path = None if options.output is None else Path(options.output)
    with StepConsole() as progress:
        written = relight(Path(options.folder), path, RelightRequest(**asked), progress)
    for warning in written.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    names = "\n".join(map(str, written.paths))
    answer(options, names, files=written.paths, warnings=written.warnings)
    return 0
