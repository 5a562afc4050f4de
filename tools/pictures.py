"""The pictures of the README, made anew: `python tools/pictures.py [--preset draft]`.

The photo is NASA's portrait of Eileen Collins, in the public domain, which comes with scikit-image.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image
from skimage.data import astronaut

import unlit
from unlit.output.images import encoded, normals

OUT = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "astronaut.jpg"
SIDE, GAP = 300, 6


def strip(result: unlit.Result) -> Image.Image:
    """Photo, albedo, normals, and the face under three new lights, in a row."""
    inside = (result.face.mask > 0)[..., None]
    lights = (unlit.lights.flash(), "side", unlit.lights.sun(-50, 35))
    tiles = [
        encoded(result.photo.image),
        encoded(result.face.maps.diffuse_albedo * inside),
        normals(result.face.normals.specular * inside),
        *(encoded(result.relight(light)) for light in lights),
    ]
    sheet = Image.new("RGB", (len(tiles) * (SIDE + GAP) - GAP, SIDE), "white")
    for number, tile in enumerate(tiles):
        picture = Image.fromarray(np.ascontiguousarray(tile)).resize((SIDE, SIDE))
        sheet.paste(picture, (number * (SIDE + GAP), 0))
    return sheet


def main() -> None:
    """Reconstruct the astronaut and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", choices=tuple(unlit.PRESETS), default="standard")
    preset = parser.parse_args().preset
    OUT.parent.mkdir(parents=True, exist_ok=True)
    strip(unlit.reconstruct(astronaut(), preset)).save(OUT, quality=88)
    print(OUT)


if __name__ == "__main__":
    main()
