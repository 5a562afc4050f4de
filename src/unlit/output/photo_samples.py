"""What the photo says of points of the mesh: the image-space maps where its camera sees them.

A point takes the values of those of the four pixels around it that lie on the same piece of
surface and on the same part of the head: eyeballs take pixels of eyes only, teeth of the open
mouth only, the lining of the mouth of it and of lips, skin of neither eyes nor mouth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage

from ..face.reconstruction import Reconstruction
from ..scene.mesh import Mesh, surface
from .beard import Beard, beard_of
from .displacement import displacement
from .evidence import features, pixel_evidence, squareness
from .geometry import Welded
from .parts import EYES, INSIDE, SKIN, TEETH
from .skin_texture import SkinTexture, skin_texture
from .texels import Texels

#: Channels of a texel: log albedo (3), log specular albedo, log roughness, then the slopes x / z
#: and y / z of the specular and of the diffuse normal in tangent space, and the displacement, mm.
#: Logarithms keep what is filled in positive.
LOGS, HEIGHT, CHANNELS = slice(0, 5), 9, 10
#: What a pixel has more than that, at the end: its worth, whether it is drawn, whether it is beard.
_WORTH, _DRAWN, _BEARD = -3, -2, -1

_DARKEST = 1e-3
_STRAIGHTEST = 0.05  # least z of a tangent-space normal
#: How far lids over the photo's eye are continued, cm, and what that is worth as evidence.
_LID, _LID_WORTH = 0.3, 0.9
#: What the best of a beard is worth: the photo's look, but measured by no stage.
_PAINTED = 0.95
_TONE = 0.25  # cm, standard deviation of the blur of what vertices take


@dataclass(frozen=True)
class Points:
    """K points: position, normal as interpolated (K, 3), tangent (K, 4), and part (K,)."""

    position: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    part: np.ndarray

    @staticmethod
    def of(mesh: Welded, texels: Texels, part: np.ndarray) -> Points:
        """Those that the texels show; part: of each triangle (F,)."""
        place, normal, tangent = (
            texels.at(values, mesh.triangles)
            for values in (mesh.position, mesh.normal, mesh.tangent)
        )
        return Points(place, normal, tangent, part[texels.triangle])


@dataclass(frozen=True)
class Samples:
    """values: (K, CHANNELS). weight: (K,) in [0, 1], what they are worth, 0 where not seen.
    feature: (K,) in [0, 1], whether they belong to brows, lips, eyes or a beard; beard: (K,) to
    that."""

    values: np.ndarray
    weight: np.ndarray
    feature: np.ndarray
    beard: np.ndarray


class PhotoSamples:
    """The image-space maps and the surface that each pixel of the crop shows."""

    def __init__(self, r: Reconstruction, part: np.ndarray) -> None:
        """part: of each triangle (F,)."""
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
        regions = r.photo.regions
        lip, eye, mouth = (
            share.ravel() > 0.5 for share in (regions.lips, regions.eyes, regions.mouth)
        )
        fits = {SKIN: ~(eye | mouth), EYES: eye, INSIDE: lip | mouth, TEETH: mouth}
        self.shows = np.stack([(shown == kind) & fits[kind] for kind in fits], axis=1)
        measured = r.face.mask > 0
        if r.conditions.shadow is not None:
            measured &= r.conditions.shadow.trust > 0
        self.shows &= measured.ravel()[:, None]
        depth = -self.point[self.shows.any(axis=1), 2]
        #: Length of a centimetre on the face, pixels.
        self.centimetre = self.camera.focal / float(np.median(depth)) if depth.size else 1.0
        maps = r.face.maps
        positive = np.dstack([maps.diffuse_albedo, maps.specular_albedo, maps.roughness])
        logs = np.log(np.maximum(positive, _DARKEST))
        bends = maps.perturbation, maps.diffuse_perturbation()
        self.displacement = displacement(r)
        distance = -self.point[:, 2].reshape(r.face.mask.shape)
        evidence = pixel_evidence(r, distance, self.centimetre)
        drawn = features(r, self.centimetre)
        bare = np.zeros_like(drawn)
        channels = np.dstack([logs, *bends, self.displacement, evidence, drawn, bare])
        self.maps = channels.reshape(pixels, -1)
        facing = (shown == SKIN).reshape(drawn.shape)
        normals = self.normal.reshape(*drawn.shape, 3)
        self._paint(beard_of(r, normals, facing, self.centimetre))
        self._lids((shown == SKIN) & eye)

    def _paint(self, beard: Beard | None) -> None:
        """Let a beard lie over the skin: smooth, as strands are no relief of it."""
        if beard is None:
            return
        share = beard.share.ravel()
        here = np.flatnonzero(share > 0)
        share = share[here, None]
        rest = (1 - share) * self.maps[here, _WORTH, None]
        part = share / (share + rest)
        flat = np.zeros((len(here), self.maps.shape[1] - 3), np.float32)
        flat[:, LOGS] = beard.logs.reshape(len(self.maps), -1)[here]
        self.maps[here, :_WORTH] += part * (flat - self.maps[here, :_WORTH])
        self.maps[here, _WORTH] = (_PAINTED * share + rest)[:, 0]
        self.maps[here, _DRAWN] = np.maximum(self.maps[here, _DRAWN], part[:, 0])
        self.maps[here, _BEARD] = part[:, 0]
        self.shows[here, SKIN] = True

    def _lids(self, over_eye: np.ndarray) -> None:
        """Let pixels that show the mesh's lids over the photo's eye take the skin beside it.

        over_eye: (pixels,) bool. The fitted lids are a little off; what is nearest to the eye in
        the photo, lashes and the lids' own rims, then goes on to the rims of the mesh.
        """
        shape = self.camera.height, self.camera.width
        away: Any = ndimage.distance_transform_edt(
            ~self.shows[:, SKIN].reshape(shape), return_indices=True
        )
        distance, (rows, columns) = away
        lids = np.flatnonzero(over_eye & (distance.ravel() < _LID * self.centimetre))
        source = (rows * self.camera.width + columns).ravel()[lids]
        self.maps[lids, :_WORTH] = self.maps[source, :_WORTH]
        self.maps[lids, _WORTH] = _LID_WORTH * self.maps[source, _WORTH]
        self.maps[lids, _DRAWN] = 1
        self.shows[lids, SKIN] = True

    @cached_property
    def toned(self) -> np.ndarray:
        """The maps (pixels, C) without what is too fine for the mesh's vertices.

        Skin, eyes and teeth are blurred apart, each by what is good evidence of it.
        """
        out = self.maps.copy()
        skin = self.maps[:, _WORTH] * (1 - self.maps[:, _DRAWN])
        for kind, worth in ((SKIN, skin), (EYES, 1.0), (TEETH, 1.0)):
            self._blur(out, self.shows[:, kind], worth)
        return out

    @cached_property
    def bearded(self) -> np.ndarray | None:
        """The same of the beard; None where there is none."""
        beard = self.maps[:, _BEARD]
        if not beard.any():
            return None
        out = self.maps.copy()
        self._blur(out, self.shows[:, SKIN] & (beard > 0), beard)
        return out

    def _blur(self, maps: np.ndarray, here: np.ndarray, worth: np.ndarray | float) -> None:
        """Blur the logs of `maps` among the pixels `here` (pixels,), by what they are worth."""
        shape = self.camera.height, self.camera.width
        blur = _TONE * self.centimetre
        weight = (here * worth).astype(np.float32).reshape(shape)
        share = ndimage.gaussian_filter(weight, blur)
        for channel in range(LOGS.stop):
            values = self.maps[:, channel].reshape(shape)
            tone = ndimage.gaussian_filter(values * weight, blur)
            maps[here, channel] = (tone / np.maximum(share, 1e-9)).ravel()[here]

    def texture(self) -> SkinTexture | None:
        """What fine structure the skin has, as baking channels."""
        shape = self.camera.height, self.camera.width
        evidence, feature = self.maps[:, _WORTH], self.maps[:, _DRAWN]
        towards = -_dot(self.normal, _unit(self.point))
        square = towards > 0.8  # there the picture's axes are nearly the tangent space's
        good = self.shows[:, SKIN] & square & (feature < 0.01)
        weight = np.where(good, evidence, 0).astype(np.float32).reshape(shape)
        flat = self.maps[:, [*range(LOGS.stop), 5, 6, 8, 9, 11]]
        return skin_texture(flat.reshape(*shape, CHANNELS), weight, self.centimetre)

    def spread(self) -> np.ndarray:
        """Standard deviations (CHANNELS,) of the skin's fine structure, robust; inf where none."""
        tone = self.toned
        good = self.shows[:, SKIN] & (self.maps[:, _WORTH] > 0.99)
        good &= self.maps[:, _DRAWN] < 0.01
        out = np.full(CHANNELS, np.inf, dtype=np.float32)
        if good.any():
            detail = np.abs(self.maps[good, LOGS] - tone[good, LOGS])
            out[LOGS] = 1.48 * np.median(detail, axis=0)
        return out

    def may_show(self, mesh: Welded, texels: Texels) -> np.ndarray:
        """(K,) bool: False where no corner of the texel's triangle is near a pixel of the face."""
        xy = np.floor(self.camera.project(mesh.position)).astype(np.int64)
        reach = int(np.ptp(xy[mesh.triangles], axis=1).max())
        face = self.shows.any(axis=1).reshape(self.camera.height, self.camera.width)
        near: Any = ndimage.maximum_filter(face, 2 * reach + 3)
        limit = np.array([self.camera.width, self.camera.height]) - 1
        x, y = np.clip(xy, 0, limit).T
        facing = _dot(mesh.normal, mesh.position) < 0
        return (near[y, x] & facing)[mesh.triangles].any(axis=1)[texels.triangle]

    def at(self, points: Points, maps: np.ndarray | None = None) -> Samples:
        """What the pixels say of the points; maps: those of `toned` instead of the full ones."""
        maps = self.maps if maps is None else maps
        point, unit = points.position, _unit(points.normal)
        cosine = -_dot(unit, _unit(point))
        corner = self.camera.project(point) - 0.5
        low = np.floor(corner).astype(np.int64)
        fraction = corner - low
        total = np.zeros((len(point), 1), dtype=np.float32)
        found = np.zeros((len(point), maps.shape[1]), dtype=np.float32)
        # On the same surface: within one pixel's footprint of the plane that the pixel shows.
        tolerance = -point[:, 2] / self.camera.focal
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            x, y = low[:, 0] + dx, low[:, 1] + dy
            inside = (x >= 0) & (y >= 0) & (x < self.camera.width) & (y < self.camera.height)
            pixel = np.where(inside, y * self.camera.width + x, 0)
            offset = point - self.point[pixel]
            above = np.abs(_dot(offset, self.normal[pixel]))
            valid = inside & self.shows[pixel, points.part] & (above < tolerance)
            valid &= _dot(unit, self.normal[pixel]) > 0.5
            weight = np.abs(1 - dx - fraction[:, 0]) * np.abs(1 - dy - fraction[:, 1])
            weight = (weight * valid).astype(np.float32)[:, None]
            total += weight
            found += weight * maps[pixel]
        found /= np.maximum(total, 1e-9)
        bends = (found[:, 5:8], found[:, 8:11])
        slopes = [_slopes(unit + bend, points.normal, points.tangent) for bend in bends]
        seen = (total[:, 0] > 1e-3) & (cosine > 0)
        # Lids and lips frame eyes and mouth: near to them is no reason for doubt there.
        worth = np.where(points.part == SKIN, found[:, _WORTH] * squareness(cosine), 1)
        values = np.hstack([found[:, LOGS], *slopes, found[:, 11:12]])
        return Samples(values, np.where(seen, worth, 0), found[:, _DRAWN], found[:, _BEARD])


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
