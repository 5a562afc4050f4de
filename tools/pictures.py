"""The pictures of README and docs, made anew: `python tools/pictures.py [--preset draft]`.

The photo is NASA's portrait of Eileen Collins, in the public domain, which comes with scikit-image.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from PIL import Image
from skimage.data import astronaut

import unlit
from unlit.output.images import encoded, normals

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SIDE, GAP = 300, 6
#: Of the animation: pixels a side, pictures in a round of the light, milliseconds of each.
MOVING, FRAMES, PAUSE = 256, 36, 70


def row(tiles: list[np.ndarray], side: int = SIDE) -> Image.Image:
    """Square uint8 pictures (S, S) or (S, S, 3), side by side."""
    sheet = Image.new("RGB", (len(tiles) * (side + GAP) - GAP, side), "white")
    for number, tile in enumerate(tiles):
        picture = Image.fromarray(np.ascontiguousarray(tile)).resize((side, side))
        sheet.paste(picture, (number * (side + GAP), 0))
    return sheet


def strip(result: unlit.Result) -> Image.Image:
    """Photo, albedo, normals, and the face under three new lights, in a row."""
    inside = (result.face.mask > 0)[..., None]
    lights = (unlit.lights.flash(), "side", unlit.lights.sun(-50, 35))
    return row(
        [
            encoded(result.photo.image),
            encoded(result.face.maps.diffuse_albedo * inside),
            normals(result.face.normals.specular * inside),
            *(encoded(result.relight(light)) for light in lights),
        ]
    )


def maps(result: unlit.Result) -> Image.Image:
    """Diffuse and specular albedo, and both shadings, in a row; scaled to show their range."""
    inside = result.face.mask > 0
    images = result.images
    return row(
        [
            encoded(result.face.maps.diffuse_albedo * inside[..., None]),
            encoded(np.repeat((result.face.maps.specular_albedo * inside)[..., None] / 5, 3, -1)),
            encoded(images.diffuse_shading / 1.6),
            encoded(4 * images.specular_shading),
        ]
    )


def lights(result: unlit.Result) -> Image.Image:
    """The face under its own light, open sky, and suns from four sides, in a row."""
    suns = [unlit.lights.sun(azimuth, 25) for azimuth in (-70, -25, 25, 70)]
    return row([encoded(result.relight(light)) for light in ("photo", "uniform", *suns)])


def round_of_light(result: unlit.Result) -> list[Image.Image]:
    """The face while a sun goes round it, before a dark ground; the photo's light at the start."""
    frames = []
    for number in range(FRAMES):
        angle = 2 * math.pi * number / FRAMES
        light = unlit.lights.sun(70 * math.sin(angle), 22 + 16 * math.cos(angle))
        picture = Image.fromarray(encoded(result.relight(light)))
        frames.append(picture.resize((MOVING, MOVING), Image.Resampling.LANCZOS))
    return frames


def main() -> None:
    """Reconstruct the astronaut and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", choices=tuple(unlit.PRESETS), default="standard")
    preset = parser.parse_args().preset
    FOLDER.mkdir(parents=True, exist_ok=True)
    result = unlit.reconstruct(astronaut(), preset)
    for make, name in ((strip, "astronaut"), (maps, "maps"), (lights, "lights")):
        make(result).save(FOLDER / f"{name}.jpg", quality=88)
    first, *others = round_of_light(result)
    first.save(
        FOLDER / "light.webp",
        save_all=True,
        append_images=others,
        duration=PAUSE,
        loop=0,
        quality=80,
        method=6,
    )
    print(FOLDER)


if __name__ == "__main__":
    main()
