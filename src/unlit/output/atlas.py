"""The maps in the mesh's own texture coordinates, with what the photo does not show filled in.

A texel shows the surface point that its centre has in the texture layout. Where the photo's
camera sees that point, the texel takes the image-space maps' values there, from those of the four
pixels around it that lie on the same piece of surface and on the same part of the head: eyeballs
take pixels of eyes only, teeth of the open mouth only, the lining of the mouth of it and of lips,
skin of neither eyes nor mouth. All other texels
are filled, and `confidence` says how:

    SEEN       measured
    GRAZING    measured, but seen at more than 70 degrees from the normal
    MIRRORED   from the other half of the face, where the layout has a mirror axis
    DIFFUSED   skin, eyes and teeth: smooth continuation over the mesh from all of the above
    PLAIN      no neighbour that was seen: a constant, see _PLAIN; teeth: the mean of those seen

Filled values are shifted to meet the measured ones at the boundary. Normals are in the tangent
space of tangent.py (y up: OpenGL), bent only where the photo or its mirror image says so, and the
same holds for the displacement. Beyond the edges of the layout's charts every map holds its
nearest texel, so that neither filtering nor mipmaps show a seam.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
import scipy.sparse as sp
from scipy import ndimage
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba
from ..scene.arrays import where
from ..scene.mesh import Mesh, surface
from .displacement import displacement
from .geometry import Welded, welded
from .parts import EYES, INSIDE, SKIN, TEETH, mirror_axis, parts

mi = mitsuba()

PLAIN, DIFFUSED, MIRRORED, GRAZING, SEEN = 0, 64, 128, 192, 255

_GRAZING_COSINE = 0.34
_CHUNK = 1 << 20  # texels at a time: bounds memory
_LIP, _EYE, _MOUTH = 1, 2, 4  # channels of Reconstruction.regions
_RIM = 1.2  # cm
_DECAY = 0.6  # of what is continued, from one level of a pyramid to the next finer one
_STRAIGHTEST = 0.05  # least z of a tangent-space normal

# Channels while baking: log albedo (3), log specular albedo, log roughness, then the slopes x / z
# and y / z of the specular and of the diffuse normal, and the displacement. Logarithms keep what is
# filled in positive.
_LOGS, _HEIGHT, _CHANNELS = slice(0, 5), 9, 10
_MIRROR_SIGN = np.array([1, 1, 1, 1, 1, -1, 1, -1, 1, 1], dtype=np.float32)
_DARKEST = 1e-3
# Where nothing is known of a part: skin mid-grey, eyes the white of an eye, mouth dark red,
# teeth of a usual shade.
# Linear albedo, specular albedo, roughness; ours.
_PLAIN = np.log(
    np.array(
        [
            [0.30, 0.30, 0.30, 0.7, 0.30],
            [0.55, 0.50, 0.47, 0.7, 0.15],
            [0.16, 0.04, 0.035, 0.7, 0.25],
            [0.52, 0.45, 0.36, 0.7, 0.15],
        ],
        dtype=np.float32,
    )
)


@dataclass(frozen=True)
class Atlas:
    """Maps of N x N texels, row 0 at v = 1; float32.

    diffuse_albedo: (N, N, 3) linear sRGB. specular_albedo, roughness: (N, N), as in
    Reconstruction. specular_normal, diffuse_normal: (N, N, 3) unit, tangent space, y up.
    displacement: (N, N) mm over the mesh along its unit normal, > 0 outwards; 0 where not known.
    crop_displacement: (S, S) mm, that of the crop's pixels, which it was baked from (it is not
    cheap: displacement.py).
    confidence: (N, N) uint8, one of PLAIN, DIFFUSED, MIRRORED, GRAZING, SEEN.
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
    texels = _texels(mesh, size)
    texel_part = part[texels.triangle]
    values = np.zeros((size * size, _CHANNELS), dtype=np.float32)
    level = np.zeros(size * size, dtype=np.uint8)
    photo = _Photo(r, part)
    near = np.flatnonzero(photo.may_show(mesh, texels))
    for start in range(0, len(near), _CHUNK):
        chunk = texels.some(near[start : start + _CHUNK])
        found, cosine = photo.sample(mesh, chunk, part[chunk.triangle])
        seen = cosine > 0
        values[chunk.index[seen]] = found[seen]
        level[chunk.index[seen]] = np.where(cosine[seen] < _GRAZING_COSINE, GRAZING, SEEN)
    part_image = np.full(size * size, 255, dtype=np.uint8)
    part_image[texels.index] = texel_part
    grid, levels = values.reshape(size, size, _CHANNELS), level.reshape(size, size)
    where = part_image.reshape(size, size)
    axis = mirror_axis(r.face.mesh.uv, r.face.mesh.triangle_uv[part == SKIN])
    if axis is not None:
        _mirror(grid, levels, where == SKIN, axis)
    _diffuse(grid, levels, where, texels, mesh, part)
    outside = where == 255
    nearest: Any = ndimage.distance_transform_edt(
        outside, return_distances=False, return_indices=True
    )
    rows, columns = (index[outside] for index in nearest)
    for image in (grid, levels):
        image[outside] = image[rows, columns]
    return _atlas(grid, levels, photo.displacement, part, mesh)


def _atlas(
    grid: np.ndarray, levels: np.ndarray, crop: np.ndarray, part: np.ndarray, mesh: Welded
) -> Atlas:
    """crop: the displacement in the crop's pixels."""
    linear = np.exp(grid[..., _LOGS])

    def normal(slopes: np.ndarray) -> np.ndarray:
        up = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
        return up / np.linalg.norm(up, axis=-1, keepdims=True)

    diffuse, specular, roughness, height = map(
        np.ascontiguousarray, (linear[..., :3], linear[..., 3], linear[..., 4], grid[..., _HEIGHT])
    )
    normals = normal(grid[..., 5:7]), normal(grid[..., 7:9])
    return Atlas(diffuse, specular, roughness, *normals, height, crop, levels, part, mesh)


@dataclass(frozen=True)
class _Texels:
    """The K texels whose centre lies in a triangle of the layout, row-major.

    index: (K,) row-major number. triangle: (K,). weights: (K, 3) barycentric, float32.
    """

    index: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray

    def some(self, rows: np.ndarray) -> _Texels:
        return _Texels(self.index[rows], self.triangle[rows], self.weights[rows])

    def at(self, values: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Values (W, C) of the vertices of `triangles` (F, 3), interpolated: (K, C)."""
        corners = triangles[self.triangle]
        return sum(self.weights[:, i : i + 1] * values[corners[:, i]] for i in range(3))  # type: ignore[return-value]


def _texels(mesh: Welded, size: int) -> _Texels:
    """Rasterise the layout: rays straight down on the triangles laid out flat in (u, v).

    Where the layout overlaps itself, the triangle with most surface per texel lies on top.
    """
    a, b, c = (mesh.position[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    surface_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    a, b, c = (mesh.uv[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    density = surface_area / np.maximum(np.abs(_cross(b - a, c - a)), 1e-16)
    height = density.argsort().argsort() / len(density)
    flat = np.concatenate([mesh.uv[mesh.triangles.ravel()], np.repeat(height, 3)[:, None]], axis=1)
    scene = Mesh(flat, np.arange(len(flat), dtype=np.int32).reshape(-1, 3)).scene
    pixel = dr.arange(mi.UInt32, size * size)
    side = dr.opaque(mi.UInt32, size)
    u = (mi.Float(pixel % side) + 0.5) / mi.Float(side)
    v = 1 - (mi.Float(pixel // side) + 0.5) / mi.Float(side)
    hit = scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(u, v, 2), mi.Vector3f(0, 0, -1)))
    index = where(hit.is_valid())
    triangle = dr.gather(mi.UInt32, hit.prim_index, index).numpy().astype(np.int32)
    index = index.numpy().astype(np.int64)
    at = np.stack([(index % size + 0.5) / size, 1 - (index // size + 0.5) / size], axis=1)
    a, b, c = a[triangle], b[triangle], c[triangle]
    area = _cross(b - a, c - a)
    area = np.where(np.abs(area) > 1e-16, area, 1e-16)
    second, third = _cross(at - a, c - a) / area, _cross(b - a, at - a) / area
    weights = np.stack([1 - second - third, second, third], axis=1)
    return _Texels(index, triangle, weights.astype(np.float32))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


class _Photo:
    """The image-space maps and the surface that each pixel of the crop shows."""

    def __init__(self, r: Reconstruction, part: np.ndarray) -> None:
        self.camera = r.face.camera
        pixels = r.face.camera.width * r.face.camera.height
        mesh = Mesh(r.face.mesh.vertices, r.face.mesh.triangles)
        hits = mesh.camera_hits(r.face.camera)
        pixel = hits.pixel.numpy()
        at, normal, _ = surface(r.face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
        self.point = np.full((pixels, 3), 1e6, dtype=np.float32)  # nowhere near
        self.normal = np.zeros((pixels, 3), dtype=np.float32)
        self.point[pixel], self.normal[pixel] = at.numpy().T, normal.numpy().T
        shown = np.full(pixels, 255, dtype=np.uint8)
        shown[pixel] = part[hits.triangle.numpy()]
        region = r.photo.regions.weights.reshape(pixels, -1)
        lip, eye, mouth = (region[:, kind] > 0.5 for kind in (_LIP, _EYE, _MOUTH))
        fits = {SKIN: ~(eye | mouth), EYES: eye, INSIDE: lip | mouth, TEETH: mouth}
        self.shows = np.stack([(shown == kind) & fits[kind] for kind in fits], axis=1)
        measured = r.face.mask > 0
        if r.conditions.shadow is not None:
            measured &= r.conditions.shadow.trust > 0
        self.shows &= measured.ravel()[:, None]
        maps = r.face.maps
        positive = np.dstack([maps.diffuse_albedo, maps.specular_albedo, maps.roughness])
        logs = np.log(np.maximum(positive, _DARKEST))
        bends = maps.perturbation, maps.diffuse_perturbation()
        self.displacement = displacement(r)
        channels = np.dstack([logs, *bends, self.displacement])
        self.maps = channels.reshape(pixels, -1)

    def may_show(self, mesh: Welded, texels: _Texels) -> np.ndarray:
        """(K,) bool: False where no corner of the texel's triangle is near a pixel of the face."""
        xy = np.floor(self.camera.project(mesh.position)).astype(np.int64)
        reach = int(np.ptp(xy[mesh.triangles], axis=1).max())
        face = self.shows.any(axis=1).reshape(self.camera.height, self.camera.width)
        near: Any = ndimage.maximum_filter(face, 2 * reach + 3)
        limit = np.array([self.camera.width, self.camera.height]) - 1
        x, y = np.clip(xy, 0, limit).T
        facing = _dot(mesh.normal, mesh.position) < 0
        return (near[y, x] & facing)[mesh.triangles].any(axis=1)[texels.triangle]

    def sample(
        self, mesh: Welded, texels: _Texels, part: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Baking channels (K, 10), and the cosine (K,) at which they are seen, 0 where not.

        part: (K,) of the texels.
        """
        point = texels.at(mesh.position, mesh.triangles)
        normal = texels.at(mesh.normal, mesh.triangles)
        unit = _unit(normal)
        cosine = -_dot(unit, _unit(point))
        corner = self.camera.project(point) - 0.5
        low = np.floor(corner).astype(np.int64)
        fraction = corner - low
        total = np.zeros((len(point), 1), dtype=np.float32)
        found = np.zeros((len(point), self.maps.shape[1]), dtype=np.float32)
        # On the same surface: within one pixel's footprint of the plane that the pixel shows.
        tolerance = -point[:, 2] / self.camera.focal
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            x, y = low[:, 0] + dx, low[:, 1] + dy
            inside = (x >= 0) & (y >= 0) & (x < self.camera.width) & (y < self.camera.height)
            pixel = np.where(inside, y * self.camera.width + x, 0)
            offset = point - self.point[pixel]
            above = np.abs(_dot(offset, self.normal[pixel]))
            valid = inside & self.shows[pixel, part] & (above < tolerance)
            valid &= _dot(unit, self.normal[pixel]) > 0.5
            weight = np.abs(1 - dx - fraction[:, 0]) * np.abs(1 - dy - fraction[:, 1])
            weight = (weight * valid).astype(np.float32)[:, None]
            total += weight
            found += weight * self.maps[pixel]
        found /= np.maximum(total, 1e-9)
        tangent = texels.at(mesh.tangent, mesh.triangles)
        bends = (found[:, 5:8], found[:, 8:11])
        slopes = [_slopes(unit + bend, normal, tangent) for bend in bends]
        seen = (total[:, 0] > 1e-3) & (cosine > 0)
        return np.hstack([found[:, _LOGS], *slopes, found[:, 11:]]), np.where(seen, cosine, 0)


def _slopes(direction: np.ndarray, normal: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """x / z and y / z (K, 2) of `direction` in the frame of tangent.py.

    normal (K, 3) and tangent (K, 4) as interpolated, not normalised.
    """
    along = tangent[:, :3]
    across = np.sign(tangent[:, 3:]) * np.cross(normal, along)
    # The inverse of the matrix with columns T, B, N, up to a factor that the slopes do not feel.
    x = _dot(direction, np.cross(across, normal))
    y = _dot(direction, np.cross(normal, along))
    z = _dot(direction, np.cross(along, across))
    handed = np.sign(tangent[:, 3])  # of the determinant
    local = _unit(np.stack([x, y, z], axis=1) * handed[:, None])
    return local[:, :2] / np.maximum(local[:, 2:], _STRAIGHTEST)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("kx,kx->k", a, b)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.sqrt(_dot(vectors, vectors)), 1e-12)[:, None]


def _mirror(grid: np.ndarray, levels: np.ndarray, skin: np.ndarray, axis: float) -> None:
    """Fill unseen texels of `skin` (N, N) from the other side of u = axis, in place."""
    size = len(grid)
    column = np.rint(2 * axis * size - 1).astype(int) - np.arange(size)
    there = (column >= 0) & (column < size)
    column = column.clip(0, size - 1)
    known = (levels > 0) & skin
    opposite = known[:, column] & there & skin
    box = _box(known | opposite)
    twin = grid[box[0]][:, column[box[1]]] * _MIRROR_SIGN
    twin += _extended(grid[box] - twin, (known & opposite)[box])
    target = (opposite & ~known)[box]
    grid[box][target] = twin[target]
    levels[box][target] = MIRRORED


def _diffuse(
    grid: np.ndarray,
    levels: np.ndarray,
    where: np.ndarray,
    texels: _Texels,
    mesh: Welded,
    part: np.ndarray,
) -> None:
    """Fill the rest, in place: a harmonic field on the mesh, shifted to meet what is known.

    The mesh, not the layout, so that the field crosses the layout's seams. where: (N, N), the
    part of each texel, 255 outside the layout.
    """
    vertex = mesh.vertex[mesh.triangles]
    flat, flat_levels = grid.reshape(-1, _CHANNELS), levels.ravel()
    given = levels > 0
    known = flat_levels[texels.index] > 0
    rim = _RIM * len(grid) * _per_centimetre(mesh, np.unique(texels.triangle[known]))
    trust = _trust(levels, where, rim).ravel()[texels.index]
    field, reached = _harmonic(
        vertex[part != INSIDE],
        *_at_vertices(vertex, texels, trust, known, flat[texels.index[known], _LOGS]),
    )

    plain = _PLAIN.copy()
    shown = part[texels.triangle[known]] == TEETH
    if shown.any():  # one row of teeth is like the other
        plain[TEETH] = flat[texels.index[known][shown], _LOGS].mean(axis=0)

    def smooth(some: _Texels) -> tuple[np.ndarray, np.ndarray]:
        kind = part[some.triangle]
        sure = (some.at(reached[:, None], vertex)[:, 0] > 0.999) & (kind != INSIDE)
        return np.where(sure[:, None], some.at(field, vertex), plain[kind]), sure

    # Known texels hold for a while what they differ by from the field, unknown ones the field.
    measured = texels.some(np.flatnonzero(known))
    kept = flat[measured.index].copy()
    flat[measured.index, _LOGS] -= smooth(measured)[0]
    unknown = np.flatnonzero(~known)
    for start in range(0, len(unknown), _CHUNK):
        some = texels.some(unknown[start : start + _CHUNK])
        flat[some.index, _LOGS], sure = smooth(some)
        flat_levels[some.index] = np.where(sure, DIFFUSED, PLAIN)
    for index in (SKIN, EYES, INSIDE, TEETH):
        here = (where == index) & given
        if here.any():
            box = _box(here, margin=len(grid) // 8)  # beyond it a few hundredths are left
            target = (where[box] == index) & ~given[box]
            grid[box][target] += _extended(grid[box], here[box])[target]
    flat[measured.index] = kept


def _per_centimetre(mesh: Welded, triangles: np.ndarray) -> float:
    """What a centimetre of these triangles has in the layout, of its side, on average."""
    corners = mesh.triangles[triangles]
    a, b, c = (mesh.position[corners[:, i]].astype(np.float64) for i in range(3))
    surface = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    a, b, c = (mesh.uv[corners[:, i]].astype(np.float64) for i in range(3))
    return float(np.sqrt(np.abs(_cross(b - a, c - a)).sum() / max(surface, 1e-12)))


def _trust(levels: np.ndarray, where: np.ndarray, rim: float) -> np.ndarray:
    """How far (N, N) in [0, 1] a texel's value may spread: less at the rim of what is known.

    The rim of the skin, `rim` texels wide, is where hair and its shadow begin. Nothing spreads
    from the mouth.
    """
    skin = (where == SKIN) & (levels > 0)
    depth: Any = ndimage.distance_transform_edt(skin)
    return np.minimum(depth / max(rim, 1), 1) ** 2 + (np.isin(where, (EYES, TEETH)) & (levels > 0))


def _at_vertices(
    triangles: np.ndarray,
    texels: _Texels,
    trust: np.ndarray,
    known: np.ndarray,
    values: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (V, C) around each vertex of the known texels' values, and the trust (V,) in it.

    trust: (K,). known: (K,) bool, true for as many texels as values (?, C) has rows.
    """
    count = int(triangles.max()) + 1

    def sums(some: _Texels, factor: np.ndarray) -> np.ndarray:
        weights = (some.weights * factor[:, None]).ravel()
        return np.bincount(triangles[some.triangle].ravel(), weights, count)

    here, trusted = texels.some(np.flatnonzero(known)), trust[known]
    total = sums(here, trusted)
    mean = np.stack([sums(here, trusted * channel) for channel in values.T], axis=1)
    share = total / np.maximum(sums(texels, np.ones(len(trust), np.float32)), 1e-9)
    return mean / np.maximum(total, 1e-9)[:, None], share


def _harmonic(
    triangles: np.ndarray, values: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Field (V, C) that is `values` where `weight` > 0.5 and smooth elsewhere; where it is known.

    Solves the umbrella Laplacian. The second result, (V,) float32, is 1 on all vertices that are
    connected to a known one.
    """
    count = len(values)
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count)).tocsr()
    graph = ((graph + graph.T) > 0).astype(np.float64)
    fixed = weight > 0.5
    piece = connected_components(graph, directed=False)[1]
    reached = np.isin(piece, piece[fixed])
    free = reached & ~fixed
    field = np.where(fixed[:, None], values, 0)
    if free.any():
        laplacian: Any = sp.diags_array(np.asarray(graph.sum(axis=1)).ravel()) - graph
        right = -laplacian[free][:, fixed] @ field[fixed]
        field[free] = spsolve(laplacian[free][:, free].tocsc(), right)
    return field.astype(np.float32), reached.astype(np.float32)


def _box(mask: np.ndarray, margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns of the smallest rectangle around `mask` (N, N), and `margin` more."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(rows[0] - margin, 0), rows[-1] + 1 + margin),
        slice(max(columns[0] - margin, 0), columns[-1] + 1 + margin),
    )


def _extended(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """`image` (N, N, C) continued smoothly beyond `known` (N, N), fading with the distance."""
    weight = known.astype(np.float32)[..., None]
    return _pull_push(image * weight, weight)


def _pull_push(image: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """A pyramid of averages (pull-push, Gortler et al. 1996).

    Each unknown texel takes the next coarser level's value, times _DECAY. image: values times
    weight, where weight (H, W, 1) is in [0, 1].
    """
    height, width = image.shape[:2]
    if height * width <= 1 or weight.all():
        return image / np.maximum(weight, 1e-9)
    pad = ((0, height % 2), (0, width % 2), (0, 0))

    def halved(values: np.ndarray) -> np.ndarray:
        even = np.pad(values, pad)
        rows = even[::2] + even[1::2]
        return rows[:, ::2] + rows[:, 1::2]

    sums = halved(weight)
    coarse_weight = np.minimum(sums, 1)
    coarse = halved(image) * (coarse_weight / np.maximum(sums, 1e-9))
    up = _doubled(_pull_push(coarse, coarse_weight))[:height, :width]
    return image + (1 - weight) * _DECAY * up


def _doubled(image: np.ndarray) -> np.ndarray:
    """Twice as many rows and columns, interpolated linearly between the texels' centres."""
    for axis in (0, 1):
        rows = np.arange(image.shape[axis])
        near = (image.take(rows + step, axis, mode="clip") for step in (-1, 1))
        both = np.stack([0.75 * image + 0.25 * other for other in near], axis=axis + 1)
        image = both.reshape(*image.shape[:axis], -1, *image.shape[axis + 1 :])
    return image
