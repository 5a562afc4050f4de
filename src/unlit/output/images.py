"""Image files: EXR holds the numbers, linear float32; PNG is for looking at, WebP inside pages.

    name               EXR                                          PNG preview
    diffuse_albedo     RGB, linear sRGB                             sRGB-encoded
    specular_albedo    Y, factor on the Beckmann lobe               0 to 2 as 0 to 255
    roughness          Y, Beckmann alpha                            0 to 1 as 0 to 255
    specular_normal    RGB = x, y, z of the unit normal, world      -1 to 1 as 0 to 255
    diffuse_normal     the same for the diffuse lobe                -1 to 1 as 0 to 255
    shading            RGB, diffuse shading E, linear               sRGB-encoded
    specular_shading   RGB, specular shading S, linear              sRGB-encoded
    render             RGB, linear sRGB = albedo E + specular S     sRGB-encoded
    displacement       Y, mm over the mesh, along its normal        16 bits: -5 to 5 as 0 to 65535
    mask               Y, 0 to 1                                    0 to 1 as 0 to 255
    environment        Y, radiance, latitude-longitude (180 x 360)  tone-mapped

Values outside a preview's range are clipped. The frames are those of scene/camera.py.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping

import numpy as np
from PIL import Image

from ..color import encode_srgb
from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba, second_thread

#: What the two ends of a displacement's PNG stand for, mm: more than skin has. 0 is 32768.
DISPLACEMENT_RANGE = (-5.0, 5.0)
DISPLACEMENT_PNG = "16 bits: {:g} to {:g} mm as 0 to 65535".format(*DISPLACEMENT_RANGE)


def bytes_of(image: np.ndarray) -> np.ndarray:
    """uint8 of values where 0 is 0 and 1 is 255; clipped. NaN becomes 0."""
    return np.rint(255 * np.clip(np.nan_to_num(image), 0, 1)).astype(np.uint8)


def encoded(linear: np.ndarray) -> np.ndarray:
    """uint8 sRGB of linear values, clipped."""
    return bytes_of(encode_srgb(linear))


def normals(unit: np.ndarray) -> np.ndarray:
    """uint8 of n / 2 + 1 / 2 for unit normals (..., 3); black where there is none."""
    known = (unit != 0).any(axis=-1, keepdims=True)
    return bytes_of((0.5 * unit + 0.5) * known)


def height_levels(height: np.ndarray) -> np.ndarray:
    """uint16 of heights (H, W) in mm: DISPLACEMENT_RANGE as 0 to 65535; clipped."""
    low, high = DISPLACEMENT_RANGE
    share = (np.asarray(height, np.float64) - low) / (high - low)
    return np.rint(65535 * np.clip(share, 0, 1)).astype(np.uint16)


def tone_mapped(radiance: np.ndarray) -> np.ndarray:
    """uint8 sRGB of a light: L / (1 + L), L scaled so that its mean is 0.25."""
    scaled = np.maximum(radiance, 0) * (0.25 / max(float(radiance.mean()), 1e-9))
    return encoded(scaled / (1 + scaled))


#: By name: the array of a reconstruction, and its preview.
MAPS: dict[str, tuple[Callable[[Reconstruction], np.ndarray], Callable[[np.ndarray], np.ndarray]]]
MAPS = {
    "diffuse_albedo": (lambda r: r.face.maps.diffuse_albedo, encoded),
    "specular_albedo": (lambda r: r.face.maps.specular_albedo, lambda image: bytes_of(image / 2)),
    "roughness": (lambda r: r.face.maps.roughness, bytes_of),
    "specular_normal": (lambda r: r.face.normals.specular, normals),
    "diffuse_normal": (lambda r: r.face.normals.diffuse, normals),
    "shading": (lambda r: r.images.diffuse_shading, encoded),
    "specular_shading": (lambda r: r.images.specular_shading, encoded),
    "render": (lambda r: r.images.render, encoded),
    "mask": (lambda r: r.face.mask, bytes_of),
    "environment": (lambda r: r.light.environment, tone_mapped),
}


def exr(image: np.ndarray) -> bytes:
    """An EXR file of (H, W) or (H, W, 3) float32, without loss."""
    mi = mitsuba()
    stream = mi.MemoryStream()
    bitmap = mi.Bitmap(np.ascontiguousarray(image, dtype=np.float32))
    with second_thread():
        bitmap.write(stream, mi.Bitmap.FileFormat.OpenEXR)
    return stream.raw_buffer()


def layered_exr(channels: Mapping[str, np.ndarray]) -> bytes:
    """An EXR file of named channels, (H, W) float32 each, such as "depth.Z": layer and channel."""
    mi = mitsuba()
    values = np.stack([np.asarray(c, dtype=np.float32) for c in channels.values()], axis=-1)
    kind = mi.Bitmap.PixelFormat.MultiChannel
    bitmap = mi.Bitmap(np.ascontiguousarray(values), kind, list(channels))
    stream = mi.MemoryStream()
    with second_thread():
        bitmap.write(stream, mi.Bitmap.FileFormat.OpenEXR)
    return stream.raw_buffer()


def png(image: np.ndarray) -> bytes:
    """A PNG file of (H, W) or (H, W, 3) uint8, or of (H, W) uint16."""
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG")
    return stream.getvalue()


def webp(image: np.ndarray, largest: int | None = None) -> bytes:
    """A WebP file of (H, W) or (H, W, 3) uint8, to look at, at most `largest` pixels a side."""
    picture = Image.fromarray(image).convert("RGB")
    if largest is not None:
        picture.thumbnail((largest, largest), Image.Resampling.LANCZOS)
    return _saved(picture, quality=90, method=4)


def webp_exact(image: np.ndarray) -> bytes:
    """A WebP file of (H, W) or (H, W, 3) uint8 without loss: for data that happen to be pixels."""
    return _saved(Image.fromarray(image).convert("RGB"), lossless=True, quality=50, method=4)


def _saved(picture: Image.Image, **options: bool | int) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, "WEBP", **options)
    return stream.getvalue()
