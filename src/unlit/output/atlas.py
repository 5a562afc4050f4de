"""The maps in the mesh's own texture coordinates, completed from good evidence only.

A texel shows the surface point that its centre has in the texture layout. On skin its value is

    base + a detail of the photo + a' detail of the mirror image + sqrt(1 - (a + a')^2) texture

where base is the smooth field of vertex_base.py, a the weight of the evidence (evidence.py), a' the
weight (1 - a) of the other half of the face, and texture the noise of skin_texture.py. Detail is
what a map has over its base. So every source fades into the others: there is no seam to hide, and
a light that differs between the halves cannot be carried over, as details alone are mirrored.
Where a = 1 the texel is the photo's to the bit. Eyes, teeth and what lines the mouth take the photo
where it shows them; an eye that it hides is as the other one, teeth as those that are seen.
`confidence` says which source a texel is of:

    SEEN       measured, nothing added
    BLENDED    measured for the most part: seen at a grazing angle, or beside hair; or a beard,
               which is the photo over the light on it (beard.py)
    MIRRORED   detail of the other half of the face, or the other eye
    DIFFUSED   the person's skin: smooth continuation with the texture of measured skin
    PLAIN      nothing of its kind was seen: a constant, see vertex_base.py; the iris of eyes that
               are both hidden

Normals are in the tangent space of tangent.py (y up: OpenGL). Beyond the edges of the layout's
charts every map holds its nearest texel, so that neither filtering nor mipmaps show a seam.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage

from ..face.reconstruction import Reconstruction
from .eyeballs import borrowed
from .eyes import Eye
from .geometry import Welded, welded
from .iris import complete_eyes
from .parts import SKIN, mirror_axis, parts, parts_of_corners
from .photo_samples import CHANNELS, HEIGHT, LOGS, PhotoSamples, Points
from .scalp import hair_of
from .texels import centimetres_per_texel, texels_of
from .vertex_base import VertexBase

PLAIN, DIFFUSED, MIRRORED, BLENDED, SEEN = 0, 64, 128, 192, 255

_CHUNK = 1 << 18  # texels at a time: bounds memory
_WHOLE = 0.999  # weight from which evidence is taken as it is
#: Mirrored brows and lips are kept within this of their base (log).
_DRAWN = 5.0
_MIRROR_SIGN = np.array([1, 1, 1, 1, 1, -1, 1, -1, 1, 1], dtype=np.float32)


@dataclass(frozen=True)
class Atlas:
    """Maps of N x N texels, row 0 at v = 1; float32.

    diffuse_albedo: (N, N, 3) linear sRGB. specular_albedo, roughness: (N, N), as in
    Reconstruction. specular_normal, diffuse_normal: (N, N, 3) unit, tangent space, y up.
    displacement: (N, N) mm over the mesh along its unit normal, > 0 outwards.
    crop_displacement: (S, S) mm, that of the crop's pixels, which it was baked from (it is not
    cheap: displacement.py).
    confidence: (N, N) uint8, one of PLAIN, DIFFUSED, MIRRORED, BLENDED, SEEN.
    part: (F,) uint8, the part of each triangle (parts.py). mesh: what the tangents belong to.
    """

    diffuse_albedo: np.ndarray
    specular_albedo: np.ndarray
    roughness: np.ndarray
    specular_normal: np.ndarray
    diffuse_normal: np.ndarray
    displacement: np.ndarray
    crop_displacement: np.ndarray
    confidence: np.ndarray
    part: np.ndarray
    mesh: Welded


def bake(
    reconstruction: Reconstruction, size: int, scalp: str = "skin", eyes: tuple[Eye, ...] = ()
) -> Atlas:
    """The maps of `reconstruction` in `size` x `size` texels of its texture layout.

    eyes: those that are completed (iris.py).

    scalp: one of SCALPS, what lies under hair; for "hair" see hair_of, and for what it raises.
    """
    r = reconstruction
    mesh = welded(r)
    part = parts(r.face.mesh.vertices, r.face.mesh.triangles, r.face.mesh.triangle_uv)
    photo = PhotoSamples(r, part)
    axis = mirror_axis(r.face.mesh.uv, r.face.mesh.triangle_uv[part == SKIN])
    hair = hair_of(r) if scalp == "hair" else None
    looked, moved = _looked_at(photo, mesh, part)
    base = VertexBase.of(photo, looked, part, axis, hair)
    texels = texels_of(mesh, size)

    values = np.zeros((size * size, CHANNELS), dtype=np.float32)
    weight = np.zeros(size * size, dtype=np.float32)
    feature = np.zeros(size * size, dtype=np.float32)
    near = np.flatnonzero(photo.may_show(looked, texels))
    for start in range(0, len(near), _CHUNK):
        chunk = texels.some(near[start : start + _CHUNK])
        found = photo.at(Points.of(looked, chunk, part))
        some = chunk.index
        values[some], feature[some] = found.values, found.feature
        weight[some] = np.where(found.weight > _WHOLE, 1, found.weight)

    out = np.zeros((size * size, CHANNELS), dtype=np.float32)
    level = np.zeros(size * size, dtype=np.uint8)
    texture = photo.texture()
    footprint = centimetres_per_texel(mesh, size)
    for start in range(0, len(texels.index), _CHUNK):
        some = texels.some(slice(start, start + _CHUNK))
        kind = part[some.triangle]
        tone, known = base.at(some, kind)
        own = weight[some.index][:, None]
        result = own * values[some.index] + (1 - own) * tone
        share = np.zeros(len(result))
        if axis is not None:
            twin = _twin(some.index, size, axis)
            share = (1 - own[:, 0]) * weight[twin] * base.mirrors(some, feature[twin])
            rows = np.flatnonzero(share > 0)
            detail = values[twin[rows]] * _MIRROR_SIGN - base.mirrored_at(some.some(rows))
            limit = base.spread + _DRAWN * feature[twin[rows], None]
            result[rows] += share[rows, None] * np.clip(detail, -limit, limit)
        if texture is not None:
            rest = 1 - (own[:, 0] + share) ** 2
            rows = np.flatnonzero((rest > 1 - _WHOLE) & (kind == SKIN))
            points = Points.of(mesh, some.some(rows), part)
            noise = texture.at(points.position, points.normal, footprint[some.triangle[rows]])
            result[rows] += np.sqrt(rest[rows, None]) * noise
        out[some.index] = result
        lent = moved[some.triangle]
        level[some.index] = _level(own[:, 0] * ~lent, share + own[:, 0] * lent, known)

    complete_eyes(eyes, mesh, texels, out, level)
    part_image = np.full(size * size, 255, dtype=np.uint8)
    part_image[texels.index] = part[texels.triangle]
    grid, levels = out.reshape(size, size, CHANNELS), level.reshape(size, size)
    outside = part_image.reshape(size, size) == 255
    nearest: Any = ndimage.distance_transform_edt(
        outside, return_distances=False, return_indices=True
    )
    rows, columns = (index[outside] for index in nearest)
    for image in (grid, levels):
        image[outside] = image[rows, columns]
    return _atlas(grid, levels, photo.displacement, part, mesh)


def _looked_at(photo: PhotoSamples, mesh: Welded, part: np.ndarray) -> tuple[Welded, np.ndarray]:
    """The mesh with an unseen eyeball moved onto the other one, and its triangles (F,) bool."""
    kind = parts_of_corners(mesh.triangles, part, len(mesh.vertex))
    seen = photo.at(Points(mesh.position, mesh.normal, mesh.tangent, kind)).weight > 0
    position, moved = borrowed(mesh, part, seen)
    return replace(mesh, position=position), moved[mesh.triangles[:, 0]]


def _level(own: np.ndarray, mirrored: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Confidence (K,) by the shares of the sources; known: whether there is a base."""
    rest = 1 - own - mirrored
    level = np.where(mirrored >= rest, MIRRORED, np.where(known, DIFFUSED, PLAIN))
    level = np.where(own >= np.maximum(mirrored, rest), BLENDED, level)
    return np.where(own == 1, SEEN, level).astype(np.uint8)


def _twin(index: np.ndarray, size: int, axis: float) -> np.ndarray:
    """Number (K,) of the texel on the other side of u = axis; of the nearest that there is."""
    row, column = np.divmod(index, size)
    other = np.rint(2 * axis * size - 1).astype(int) - column
    return row * size + other.clip(0, size - 1)


def _atlas(
    grid: np.ndarray, levels: np.ndarray, crop: np.ndarray, part: np.ndarray, mesh: Welded
) -> Atlas:
    """crop: the displacement in the crop's pixels."""
    linear = np.exp(grid[..., LOGS])

    def normal(slopes: np.ndarray) -> np.ndarray:
        up = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
        return up / np.linalg.norm(up, axis=-1, keepdims=True)

    diffuse, specular, roughness, height = map(
        np.ascontiguousarray, (linear[..., :3], linear[..., 3], linear[..., 4], grid[..., HEIGHT])
    )
    normals = normal(grid[..., 5:7]), normal(grid[..., 7:9])
    return Atlas(diffuse, specular, roughness, *normals, height, crop, levels, part, mesh)
