"""A beard, painted on the head as the photo has it.

A beard is no skin: the stages leave it out, and the head model has none. Without it a bearded man
has a bare chin with crumbs of hair at its edge. It is laid on the skin as a colour: the photo over
the light that falls there. The light is the face's own diffuse shading as a function of the
surface's normal, a spherical-harmonic series of order two (Ramamoorthi and Hanrahan 2001) fitted
to the skin around: a beard stands out before chin and neck, so that the mesh's own shadows, the
chin's on the neck above all, are not those of the beard. What hair reflects as a mirror does stays
in its colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from ..face.reconstruction import Reconstruction
from ..perception.covers import worn
from ..perception.measures import disk, filled
from ..perception.regions import beard_share
from ..perception.topology import FACE_OVAL
from .base_tone import Surface, base_tone
from .evidence import ramp

#: Gaps between a beard's pieces that belong to it, and the blur of its edge, cm: the parser is
#: seldom sure of all of it.
_GAP, _EDGE = 1.2, 0.12
#: The beard's share from which a pixel begins to count as beard, and counts as nothing else.
_SHARE = (0.15, 0.5)
#: How far outside the face's outline a beard fades: what is farther hangs before the neck, cm.
_HANGS = (0.2, 1.0)
#: Light on it, of the best-lit part's, between which the colour begins to be believed, and is.
_LIGHT = (0.05, 0.2)
#: Distance, cm, up to which the skin's shading tells that on the beard.
_NEAR = 3.0
#: Albedo of hair. Its 99th percentile is kept within the upper bound, so that no strand is cut off.
_BOUNDS = (0.004, 0.8)
#: Specular albedo and roughness (Beckmann) of what is drawn: hardly any shine, as hair has none of
#: the skin's.
_SPECULAR, _ROUGHNESS = 0.15, 0.5
#: Where nothing was seen a beard ends within so many centimetres; the share of beard in what is
#: around, from which a place is beard at all, and wholly.
_RETURN, _COVER = 2.5, (0.2, 0.65)


@dataclass(frozen=True)
class Beard:
    """share: (S, S) float32 in [0, 1], how far each pixel is beard. logs: (S, S, 5) float32, log
    of albedo (linear sRGB), specular albedo and roughness."""

    share: np.ndarray
    logs: np.ndarray


def beard_of(
    r: Reconstruction, normal: np.ndarray, skin: np.ndarray, centimetre: float
) -> Beard | None:
    """The beard of `r`; None where no parser was asked, or it found none.

    normal: (S, S, 3) of the mesh. skin: (S, S) bool, pixels that show the mesh's skin. centimetre:
    its length on the face, pixels.
    """
    regions, size = r.photo.regions, len(r.photo.image)
    landmarks = r.photo.landmarks[:, :2]
    if regions.shares is None or "beard" not in worn(regions.shares, landmarks, size):
        return None
    share = beard_share(regions.shares, landmarks, size)
    share = cv2.morphologyEx(share, cv2.MORPH_CLOSE, disk(0.5 * _GAP * centimetre))
    share *= regions.lips + regions.mouth + regions.eyes < 0.5
    share = ramp(ndimage.gaussian_filter(share, _EDGE * centimetre), *_SHARE) * skin
    beside: Any = ndimage.distance_transform_edt(~filled(landmarks, size, FACE_OVAL))
    share *= 1 - ramp(beside / centimetre, *_HANGS)
    light = _light(r, normal, share, centimetre)
    if light is None:
        return None
    sure, bright = share > 0.5, light.mean(axis=-1)
    share *= ramp(bright / np.percentile(bright[sure], 90), *_LIGHT)
    albedo = np.maximum(r.photo.image, 0) / light
    albedo *= min(1.0, _BOUNDS[1] / max(np.percentile(albedo[sure], 99), 1e-6))
    logs = np.empty((size, size, 5), np.float32)
    logs[..., :3] = np.log(np.clip(albedo, *_BOUNDS))
    logs[..., 3:] = np.log((_SPECULAR, _ROUGHNESS))
    return Beard(share.astype(np.float32), logs)


def _light(
    r: Reconstruction, normal: np.ndarray, share: np.ndarray, centimetre: float
) -> np.ndarray | None:
    """Irradiance over pi (S, S, 3) on the normals, as the skin about the beard has it.

    None where there is no beard, or too little skin to tell by.
    """
    if not (share > 0.5).any():
        return None
    measured = (r.face.mask > 0.5) & (share == 0) & (r.photo.regions.skin > 0.5)
    if r.conditions.shadow is not None:
        measured &= r.conditions.shadow.trust > 0
    away: Any = ndimage.distance_transform_edt(share < 0.5)
    near = np.exp(-((away[measured] / (_NEAR * centimetre)) ** 2)) + 1e-3
    if np.count_nonzero(near > 0.1) < 9:
        return None
    known = r.images.diffuse_shading[measured]
    root = np.sqrt(near)[:, None]
    series = np.linalg.lstsq(root * _harmonics(normal[measured]), root * known, rcond=1e-3)[0]
    # A series is not to be believed beyond what it was fitted to.
    least, most = np.percentile(known, (2, 98), axis=0)
    return np.clip(_harmonics(normal) @ series, np.maximum(least, 1e-3), np.maximum(most, 1e-3))


def _harmonics(normal: np.ndarray) -> np.ndarray:
    """(..., 9): the polynomials of unit vectors that span the harmonics of order two."""
    x, y, z = np.moveaxis(normal, -1, 0)
    rest = (x * y, y * z, x * z, x * x - y * y, 3 * z * z - 1)
    return np.stack([np.ones_like(x), x, y, z, *rest], axis=-1)


@dataclass(frozen=True)
class BeardBase:
    """The smooth part of a beard on V vertices. cover: (V,) in [0, 1]. tone: (V, 5) logs."""

    cover: np.ndarray
    tone: np.ndarray

    def over(self, field: np.ndarray) -> np.ndarray:
        """`field` (V, C), whose first channels are such logs, with the beard over it."""
        out = field.copy()
        out[:, :5] += self.cover[:, None] * (self.tone - field[:, :5])
        return out


def beard_base(
    surface: Surface, tone: np.ndarray, share: np.ndarray, weight: np.ndarray, twin: np.ndarray
) -> BeardBase | None:
    """What is between the beard's parts that were seen, and beside them; None if none was.

    tone: (V, 5) logs where there is beard. share: (V,) in [0, 1], how far a vertex is beard, and
    weight: (V,) the evidence for that. twin: (V,), as for base_tone.
    """
    held = share * weight
    if held.max() <= 0.5:
        return None
    change = np.where(twin != np.arange(len(twin)), weight[twin], 0) * (1 - weight)
    cover = base_tone(surface, share[:, None], weight, 0 * share[:, None], twin, change, _RETURN)
    typical = np.broadcast_to(np.median(tone[held > 0.5], axis=0), tone.shape)
    colour = base_tone(surface, tone, held, typical, twin, change * share[twin])
    return BeardBase(ramp(cover.field[:, 0], *_COVER).astype(np.float32), colour.field)
