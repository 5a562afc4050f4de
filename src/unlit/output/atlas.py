"""The maps in the mesh's own texture coordinates, completed from good evidence only.

A texel shows the surface point that its centre has in the texture layout. On skin its value is

    base + a detail of the photo + a' detail of the mirror image + sqrt(1 - (a + a')^2) texture

where base is the smooth field of base_tone.py, a the weight of the evidence (evidence.py), a' the
weight (1 - a) of the other half of the face, and texture the noise of skin_texture.py. Detail is
what a map has over its base. So every source fades into the others: there is no seam to hide, and
a light that differs between the halves cannot be carried over, as details alone are mirrored.
Where a = 1 the texel is the photo's to the bit. Eyes and what lines the mouth take the photo where
it shows them; an eye that it hides is as the other one. `confidence` says which source a texel is
of:

    SEEN       measured, nothing added
    BLENDED    measured for the most part: seen at a grazing angle, or beside hair
    MIRRORED   detail of the other half of the face, or the other eye
    DIFFUSED   the person's skin: smooth continuation with the texture of measured skin
    PLAIN      nothing of its kind was seen: a constant, see _PLAIN

Normals are in the tangent space of tangent.py (y up: OpenGL). Beyond the edges of the layout's
charts every map holds its nearest texel, so that neither filtering nor mipmaps show a seam.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy import ndimage
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ..face.reconstruction import Reconstruction
from .base_tone import BaseTone, Surface, base_tone
from .evidence import ramp
from .eyeballs import borrowed
from .geometry import Welded, welded
from .parts import EYES, INSIDE, SKIN, mirror_axis, parts
from .photo_samples import CHANNELS, HEIGHT, LOGS, PhotoSamples, Points
from .texels import Texels, centimetres_per_texel, texels_of

PLAIN, DIFFUSED, MIRRORED, BLENDED, SEEN = 0, 64, 128, 192, 255

_CHUNK = 1 << 18  # texels at a time: bounds memory
_WHOLE = 0.999  # weight from which evidence is taken as it is
_MIRROR_SIGN = np.array([1, 1, 1, 1, 1, -1, 1, -1, 1, 1], dtype=np.float32)
#: Distance in the layout between a vertex and the mirror image of its twin, at most.
_TWIN = 3e-3
#: Difference in log luminance from the skin's typical value, and of a spot from the tone around
#: it, at which skin counts for half as tone, and at which it is no longer mirrored.
_UNLIKE, _SPOT = 0.5, (0.15, 0.4)
#: Difference of the tones of both halves (log, root mean square) at which their lights disagree.
_DISAGREE = (0.1, 0.3)
#: Mirrored details are kept within so many standard deviations of the skin's fine structure, and
#: _MOTTLE (log) in any case, as a mole is not to be there twice; brows and lips within _DRAWN.
_MOLE, _MOTTLE, _DRAWN = 2.0, 0.15, 5.0
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Where nothing is known of a part: skin mid-grey, eyes the white of an eye, mouth dark red.
# Linear albedo, specular albedo, roughness; ours.
_PLAIN = np.log(
    np.array(
        [
            [0.30, 0.30, 0.30, 0.7, 0.30],
            [0.55, 0.50, 0.47, 0.7, 0.15],
            [0.16, 0.04, 0.035, 0.7, 0.25],
        ],
        dtype=np.float32,
    )
)


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


def bake(reconstruction: Reconstruction, size: int) -> Atlas:
    """The maps of `reconstruction` in `size` x `size` texels of its texture layout."""
    r = reconstruction
    mesh = welded(r)
    part = parts(r.face.mesh.vertices, r.face.mesh.triangles, r.face.mesh.triangle_uv)
    photo = PhotoSamples(r, part)
    axis = mirror_axis(r.face.mesh.uv, r.face.mesh.triangle_uv[part == SKIN])
    looked, moved = _looked_at(photo, mesh, part)
    base = _Base.of(photo, looked, part, axis)
    texels = texels_of(mesh, size)

    values = np.zeros((size * size, CHANNELS), dtype=np.float32)
    weight = np.zeros(size * size, dtype=np.float32)
    feature = np.zeros(size * size, dtype=np.float32)
    near = np.flatnonzero(photo.may_show(looked, texels))
    for start in range(0, len(near), _CHUNK):
        chunk = texels.some(near[start : start + _CHUNK])
        found = photo.at(Points.of(looked, chunk, part))
        some = chunk.index
        values[some], weight[some], feature[some] = found.values, found.weight, found.feature

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
    kind = np.full(len(mesh.vertex), SKIN, dtype=np.uint8)
    kind[np.unique(mesh.triangles[part == EYES])] = EYES
    seen = photo.at(Points(mesh.position, mesh.normal, mesh.tangent, kind)).weight > 0
    position, moved = borrowed(mesh, part, seen)
    return replace(mesh, position=position), moved[mesh.triangles].all(axis=1)


def _level(own: np.ndarray, mirrored: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Confidence (K,) by the shares of the sources; known: whether there is a base."""
    rest = 1 - own - mirrored
    level = np.where(mirrored >= rest, MIRRORED, np.where(known, DIFFUSED, PLAIN))
    level = np.where(own >= np.maximum(mirrored, rest), BLENDED, level)
    return np.where(own > _WHOLE, SEEN, level).astype(np.uint8)


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


@dataclass(frozen=True)
class _Base:
    """The smooth part of all channels on the mesh's V vertices.

    vertex: (F, 3) into them. tone: (V, CHANNELS) fields; known: (V,) 1 where they mean anything.
    twins: (V,) in [0, 1], whether a vertex has a mirror image, and like: how far what is there
    has the look of skin. spread: (CHANNELS,) bound on mirrored details.
    """

    vertex: np.ndarray
    tone: BaseTone
    known: np.ndarray
    twins: np.ndarray
    like: np.ndarray
    spread: np.ndarray

    @staticmethod
    def of(photo: PhotoSamples, mesh: Welded, part: np.ndarray, axis: float | None) -> _Base:
        vertex = mesh.vertex[mesh.triangles]
        count = int(mesh.vertex.max()) + 1
        first = np.unique(mesh.vertex, return_index=True)[1]  # a corner of each vertex
        kind = np.full(len(mesh.vertex), INSIDE, dtype=np.uint8)
        for one in (SKIN, EYES):
            kind[np.unique(mesh.triangles[part == one])] = one
        of_vertex = np.full(count, INSIDE, dtype=np.uint8)
        np.minimum.at(of_vertex, mesh.vertex, kind)
        normal = mesh.normal[first]
        points = Points(mesh.position[first], normal, mesh.tangent[first], of_vertex)
        found = photo.at(points, photo.toned())
        surface = Surface.of(mesh.position[first], vertex[part != INSIDE])

        # Tone is that of skin alone: features, and what is far from typical, do not spread.
        weight = found.weight * np.where(of_vertex == SKIN, 1 - found.feature, 1)
        weight[of_vertex == INSIDE] = 0
        values = found.values.astype(np.float64)
        values[:, LOGS.stop :] = 0
        typical = np.zeros_like(values)
        for one in (SKIN, EYES):
            here = of_vertex == one
            good = here & (weight > 0.5)
            typical[here, LOGS] = (
                np.median(values[good, LOGS], axis=0) if good.any() else _PLAIN[one]
            )
        skin = of_vertex == SKIN
        evidence = weight.copy()
        unlike = (values[:, :3] - typical[:, :3]) @ _LUMINANCE
        weight[skin] /= 1 + (unlike[skin] / _UNLIKE) ** 2

        twin, has = _twins(mesh, first, of_vertex == SKIN, axis)
        change = np.where(has, evidence[twin], 0) * (1 - evidence)
        both = has & (weight > 0.5) & (weight[twin] > 0.5)
        if both.any():
            difference = (values - values[twin])[both, :3]
            rms = np.sqrt((difference**2).mean())
            change *= 1 - ramp(rms, *_DISAGREE)
        tone = base_tone(surface, values, weight, typical, twin, change)
        spot = np.abs((values[:, :3] - tone.field[:, :3]) @ _LUMINANCE)
        like = np.where(found.weight > 0, 1 - ramp(spot, *_SPOT), 0)
        known = _known(vertex[part != INSIDE], weight > 0, of_vertex, count)
        return _Base(
            vertex,
            tone,
            known.astype(np.float32),
            has.astype(np.float32),
            like[twin].astype(np.float32),
            np.maximum(photo.spread() * _MOLE, _MOTTLE),
        )

    def at(self, texels: Texels, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The base (K, CHANNELS) of texels, and whether it is known (K,); part: theirs."""
        field = texels.at(self.tone.field, self.vertex)
        known = (texels.at(self.known[:, None], self.vertex)[:, 0] > 0.999) & (part != INSIDE)
        field[~known, LOGS], field[~known, LOGS.stop :] = _PLAIN[part[~known]], 0
        return field, known

    def mirrored_at(self, texels: Texels) -> np.ndarray:
        """The base (K, CHANNELS) of the texels' mirror images."""
        return texels.at(self.tone.mirrored, self.vertex)

    def mirrors(self, texels: Texels, feature: np.ndarray) -> np.ndarray:
        """(K,) in [0, 1]: how far the detail of the mirror image may be taken over.

        feature: (K,) of the mirror image. Spots that are no features are not: hair, a scar, a
        shadow.
        """
        both = texels.at(np.stack([self.twins, self.like], axis=1), self.vertex)
        return np.maximum(both[:, 1], feature) * (both[:, 0] > _WHOLE)


def _twins(
    mesh: Welded, first: np.ndarray, skin: np.ndarray, axis: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Number (V,) of each vertex's mirror image about u = axis, and whether it has one (V,).

    first: (V,) a corner of each vertex. skin: (V,) bool; others have none.
    """
    own = np.arange(len(first))
    if axis is None:
        return own, np.zeros(len(first), bool)
    distance, near = KDTree(mesh.uv).query(mesh.uv[first] * (-1, 1) + (2 * axis, 0))
    twin = mesh.vertex[near]
    has = (distance < _TWIN) & skin & skin[twin]
    return np.where(has, twin, own), has


def _known(triangles: np.ndarray, seen: np.ndarray, kind: np.ndarray, count: int) -> np.ndarray:
    """(V,) bool: the skin if any of it was seen, and of the eyeballs those of which some was."""
    edges = triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    piece = connected_components(graph, directed=False)[1]
    reached = np.isin(piece, piece[seen])
    return np.where(kind == SKIN, (seen & (kind == SKIN)).any(), reached & (kind != INSIDE))
