"""A relit face as layers of one EXR file, for compositing.

    R G B A                the face under the light: diffuse + specular; A: the mask
    diffuse.R G B          albedo times diffuse shading, direct and indirect
    specular.R G B         the specular lobe, direct and indirect
    indirect.R G B         what of both came by way of the face itself
    albedo.R G B           diffuse albedo
    specular_albedo.Y      factor on the Beckmann lobe
    roughness.Y            Beckmann alpha
    visibility.Y           share of the light's diffuse shading that the head leaves, 0 to 1
    normal.X Y Z           unit, of the specular lobe, world frame: x right, y up, z to the camera
    depth.Z                cm along the camera's axis; 0 where there is no face
    mask.Y                 the same as A

The first four layers are multiplied by A, as EXR wants it. All are linear sRGB or plain numbers,
float32. They come from the transport renderer, whose lobes and bounces are kept apart.
"""

from __future__ import annotations

import numpy as np

from ..color import luminance
from ..face.reconstruction import Reconstruction
from ..output.images import layered_exr
from ..photo.photo import Photo
from ..render.relighter import FaceUnderLight, Relighter
from .composite import check_same

#: Of the light's mean radiance, a surface that gets less than so much faces no light.
_FACED = 1e-5
#: Layers of colours and of vectors, and the names of their channels.
_CHANNELS = {1: "Y", 3: "RGB"}


def passes_exr(
    face: Reconstruction, environment: np.ndarray, turn: float = 0.0, photo: Photo | None = None
) -> bytes:
    """The file for `environment` (H, W[, 3]), turned by `turn` degrees.

    photo: the result's own; the layers then have its size, and lie where the face is in it. Raises
    PhotoError if it is another.
    """
    if photo is not None:
        check_same(face, photo)
    layers = passes(face, environment, turn)
    if photo is not None:
        layers = {name: _placed(name, values, face, photo) for name, values in layers.items()}
    channels: dict[str, np.ndarray] = {}
    for name, values in layers.items():
        wide = values.reshape(*values.shape[:2], -1)
        letters = _letters(name, wide.shape[2])
        for k, letter in enumerate(letters):
            channels[f"{name}.{letter}" if name else letter] = wide[..., k]
    return layered_exr(channels)


def passes(
    face: Reconstruction, environment: np.ndarray, turn: float = 0.0
) -> dict[str, np.ndarray]:
    """Layers by name, (S, S[, C]) float32, in the crop; "" is R, G, B, A."""
    relighter = Relighter(face.face)
    under = relighter.under(environment, [turn])
    shading, maps, mask = under.shading(0), face.face.maps, face.face.mask
    pixel = relighter.pixel

    def image(values: np.ndarray) -> np.ndarray:
        """(S, S[, C]) of values (P[, C]) at the pixels of the face."""
        out = np.zeros((mask.size, *values.shape[1:]), np.float32)
        out[pixel] = values
        return out.reshape(*mask.shape, *values.shape[1:])

    colour = maps.diffuse_albedo.reshape(-1, 3)[pixel] * mask.reshape(-1, 1)[pixel]
    gloss = (maps.specular_albedo * mask).reshape(-1, 1)[pixel]
    diffuse = image(colour * (shading.diffuse[0] + shading.diffuse[1]))
    specular = image(gloss * (shading.specular[0] + shading.specular[1]) * np.ones(3))
    inside = image(np.ones(len(pixel), np.float32))
    return {
        "": np.concatenate([diffuse + specular, (mask * inside)[..., None]], axis=-1),
        "diffuse": diffuse,
        "specular": specular,
        "indirect": image(colour * shading.diffuse[1] + gloss * shading.specular[1]),
        "albedo": maps.diffuse_albedo * inside[..., None],
        "specular_albedo": maps.specular_albedo * inside,
        "roughness": maps.roughness * inside,
        "visibility": image(_visibility(under, environment)),
        "normal": face.face.normals.specular * inside[..., None],
        "depth": image(-relighter.points.position.numpy().T[:, 2]),
        "mask": mask * inside,
    }


def _visibility(under: FaceUnderLight, environment: np.ndarray) -> np.ndarray:
    """(P,) in [0, 1]; 0 where the surface is turned away from all light of (H, W[, 3])."""
    shares = []
    for e in (under.shading(0).diffuse[0], under.unshadowed(0)):
        shares.append(luminance(e * np.ones(3, np.float32)))
    direct, every = shares
    light = environment if environment.ndim == 3 else environment[..., None]
    rows = len(light)
    weight = np.sin((np.arange(rows) + 0.5) * (np.pi / rows))  # the solid angle of a row's pixels
    by_row = luminance(light * np.ones(3, np.float32)).mean(axis=1)
    floor = max(_FACED * float(np.average(by_row, weights=weight)), 1e-30)
    return np.where(every > floor, np.clip(direct / np.maximum(every, floor), 0, 1), 0)


def _letters(name: str, count: int) -> str:
    if name in ("normal", "depth"):
        return "XYZ"[-count:]
    return "RGBA" if not name else _CHANNELS[count]


def _placed(name: str, values: np.ndarray, face: Reconstruction, photo: Photo) -> np.ndarray:
    """(H, W[, C]): a layer at the photo's size; what is not multiplied by the mask keeps to it.

    At the mask's rim a mean over pixels with and without a face would be neither.
    """
    crop, inside = face.photo.crop, (face.face.mask > 0).astype(np.float32)
    wide = values.reshape(*values.shape[:2], -1)
    size = photo.pixels.shape[:2]

    def means(layer: np.ndarray) -> np.ndarray:
        empty = np.zeros((*size, layer.shape[2]), np.float32)
        return crop.paste(layer, empty, np.ones_like(inside))

    out = means(wide)
    if name not in ("", "diffuse", "specular", "indirect", "mask"):
        covered = means(inside[..., None])
        out = np.where(covered > 0.5, out / np.maximum(covered, 0.5), 0)
    if name == "normal":
        out /= np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-6)
    return out.reshape(*size, *values.shape[2:])
