"""One picture that shows a whole reconstruction at a glance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..color import encode_srgb
from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba
from ..scene.light import latlong_directions, latlong_solid_angles
from .images import bytes_of, encoded, normals, png, tone_mapped
from .relit import LIGHTS, Relit, relit

_TILE = 320
_CAPTION = 24
_GAP = 8
_PAPER = 24
_INK = (225, 225, 225)
_PREVIEW_TILE = 256

#: A tile: its caption, and how to make its square picture (S, S) or (S, S, 3) uint8.
Tile = tuple[str, Callable[[Reconstruction], np.ndarray]]


def montage(reconstruction: Reconstruction, pictures: Relit | None = None) -> np.ndarray:
    """(H, W, 3) uint8 sRGB: photo, render, error, maps, light, mesh, and three new lights.

    pictures: of `relit`, where they are there already.
    """
    lit = relit(reconstruction) if pictures is None else pictures
    new: list[Tile] = [
        (f"new light: {LIGHTS[name].caption}", lambda _, picture=picture: picture)
        for name, picture in lit.items()
    ]
    return _sheet(reconstruction, (*_TILES, *new), columns=4, tile=_TILE)


def montage_png(reconstruction: Reconstruction, pictures: Relit | None = None) -> bytes:
    """The montage as a PNG file."""
    return png(montage(reconstruction, pictures))


def preview_png(reconstruction: Reconstruction) -> bytes:
    """A PNG file of a run's state, in a fraction of the montage's time: nothing is relit."""
    return png(_sheet(reconstruction, _PREVIEW_TILES, columns=3, tile=_PREVIEW_TILE))


def error(r: Reconstruction) -> np.ndarray:
    """(S, S, 3) uint8: 4 times the absolute difference of sRGB-encoded values, in the mask."""
    difference = np.abs(encode_srgb(r.images.render) - encode_srgb(r.photo.image))
    return bytes_of(4 * difference * _inside(r))


def clay(r: Reconstruction) -> np.ndarray:
    """(S, S) uint8: the whole mesh as the camera sees it, grey, lit from above the camera."""
    from ..scene.mesh import Mesh, surface

    mesh = Mesh(r.face.mesh.vertices, r.face.mesh.triangles)
    hits = mesh.camera_hits(r.face.camera)
    _, normal, _ = surface(r.face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    toward = np.array([0.5, 0.5, 0.7])
    cosine = np.maximum(normal.numpy().T @ toward, 0)
    picture = np.full(r.face.mask.shape, _PAPER, dtype=np.uint8)
    picture.ravel()[hits.pixel.numpy()] = encoded(0.04 + 0.55 * cosine)
    return picture


def light(r: Reconstruction) -> np.ndarray:
    """(180, 180[, 3]) uint8: the light as a map, and on a matte and on a mirror ball.

    As seen by the camera: the map is mirrored against environment.png, so that light from the
    photo's left is left.
    """
    radiance = r.light.rasterize(90, 180)  # as fine as a tile shows
    height, width, *channels = radiance.shape
    ball = height // 2 * 2
    ys, xs = (np.mgrid[0:ball, 0:ball] + 0.5) * (2 / ball) - 1
    x, y = xs * 1.06, -ys * 1.06
    inside = x * x + y * y < 1
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], axis=-1)
    # Far away, the camera looks along -z: d = 2 (n . z) n - z.
    mirrored = 2 * normal[..., 2:] * normal - (0.0, 0.0, 1.0)
    grid = (18, 36)
    coarse = r.light.rasterize(*grid).reshape(grid[0] * grid[1], -1)
    coarse = coarse * latlong_solid_angles(*grid).reshape(-1, 1) / np.pi
    cosine = np.maximum(normal.reshape(-1, 3) @ latlong_directions(*grid).reshape(-1, 3).T, 0)
    matte = (cosine @ coarse).reshape(ball, ball, *channels)
    picture = np.full((width, width, *channels), _PAPER, dtype=np.uint8)
    top = (width - height - ball) // 2
    looks = tone_mapped(np.concatenate([radiance, r.light.radiance(mirrored)], axis=1))
    picture[top : top + height] = looks[:, :width][:, ::-1]
    below = slice(top + height, top + height + ball)
    picture[below, :ball][inside] = encoded(0.6 * matte)[inside]
    picture[below, ball:][inside] = looks[:, width:][inside]
    return picture


def _inside(r: Reconstruction) -> np.ndarray:
    return (r.face.mask > 0)[..., None]


_PHOTO: Tile = ("photo", lambda r: encoded(r.photo.image))
_RENDER: Tile = ("render", lambda r: encoded(r.images.render))
_ERROR: Tile = ("error x 4", error)
_CLAY: Tile = ("mesh", clay)
_DIFFUSE: Tile = ("diffuse albedo", lambda r: encoded(r.face.maps.diffuse_albedo * _inside(r)))
_NORMALS: Tile = ("specular normals", lambda r: normals(r.face.normals.specular * _inside(r)))
_LIGHT: Tile = ("light, seen from the camera", light)
_TILES: tuple[Tile, ...] = (
    _PHOTO,
    _RENDER,
    _ERROR,
    _CLAY,
    _DIFFUSE,
    (
        "specular albedo, 0 to 2",
        lambda r: bytes_of(r.face.maps.specular_albedo / 2 * (r.face.mask > 0)),
    ),
    _NORMALS,
    ("diffuse normals", lambda r: normals(r.face.normals.diffuse * _inside(r))),
    _LIGHT,
)
_PREVIEW_TILES = (_PHOTO, _RENDER, _CLAY, _DIFFUSE, _NORMALS, _LIGHT)


def _sheet(r: Reconstruction, tiles: tuple[Tile, ...], columns: int, tile: int) -> np.ndarray:
    """Captioned squares of `tile` pixels in rows of `columns`."""
    mitsuba()
    rows = -(-len(tiles) // columns)
    step_x, step_y = tile + _GAP, tile + _CAPTION + _GAP
    size = (columns * step_x + _GAP, rows * step_y + _GAP)
    sheet = Image.new("RGB", size, (_PAPER,) * 3)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(size=15)
    for number, (caption, make) in enumerate(tiles):
        row, column = divmod(number, columns)
        x, y = _GAP + column * step_x, _GAP + row * step_y
        picture = Image.fromarray(make(r)).convert("RGB")
        draw.text((x + 2, y + _CAPTION / 2), caption, fill=_INK, font=font, anchor="lm")
        sheet.paste(picture.resize((tile, tile), Image.Resampling.LANCZOS), (x, y + _CAPTION))
    return np.asarray(sheet)
