"""What a pixel of the crop is worth as evidence of the skin's own look.

Bad evidence in an atlas is worse than none: a strand of hair, its blur and its shadow become
specks on the scalp, and what is seen at a grazing angle is smeared over the jaw. A pixel counts

    not at all  outside the mask, in a cast shadow, where next to no light falls, within the blur
                of hair, beard, frames and background, at the edge of what hides a part of the
                head behind it, and on islands of skin between these;
    in part     up to the depth at which nothing of these is felt any more;
    wholly      deeper than that.

How squarely it is seen counts when a surface point takes it (squareness).
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from ..color import luminance
from ..face.reconstruction import Reconstruction
from ..perception.measures import filled
from ..perception.parser import CLASSES
from ..perception.topology import FACE_OVAL

#: Cosine to the camera between which a view begins to count, and counts wholly: 76 and 63 degrees.
_COSINE = (0.25, 0.45)
#: The same of the distance to what is no face, cm.
_DEPTH = (0.15, 0.5)
#: The same of the distance to hair, whose strands and shadow reach farther, cm; and the parser's
#: share from which something is hair.
_HAIR_DEPTH, _HAIR = (0.3, 1.0), 0.3
#: A step of the surface's depth from one pixel to the next, of a pixel's width, that hides what
#: lies behind: the outline of jaw and nose, where the fit is a little off.
_STEP = 6.0
#: Departure of the tone (log) from that of skin deeper than _DEEP, cm, between which a place
#: beside the face is in doubt: then 1 + _DOUBT times the depth is asked of it. What is dark on
#: neck and temples is mostly the shadow of jaw or hair.
_UNLIKE, _DEEP, _DOUBT = (0.3, 0.7), 1.0, 4.0
#: An island of face that is nowhere as deep as this, cm, lies between strands of hair.
_ISLAND = 0.8
#: The same of the light that falls on the skin, of the face's 90th percentile. Where less falls,
#: and at the edge to it, the albedo is a guess.
_LIGHT = (0.03, 0.12)
#: How far beyond brows, lips and eyes their drawn look goes on: lashes, lids' and lips' lines, cm.
_FEATURE_RIM = 0.4


def pixel_evidence(r: Reconstruction, distance: np.ndarray, centimetre: float) -> np.ndarray:
    """(S, S) float32 in [0, 1].

    distance: (S, S) cm, depth of what each pixel shows, far where nothing. centimetre: its length
    on the face, pixels.
    """
    measured = r.face.mask > 0
    if r.conditions.shadow is not None:
        measured &= r.conditions.shadow.trust > 0
    face = measured & (r.photo.regions.background < 0.5)
    step = ndimage.maximum_filter(distance, 3) - ndimage.minimum_filter(distance, 3)
    face &= step < 2 * _STEP / centimetre
    light = luminance(r.images.diffuse_shading)
    full = float(np.percentile(light[face], 90)) if face.any() else 0.0
    if full > 0:
        light = light / full
        face &= light > _LIGHT[0]
    depth: Any = ndimage.distance_transform_edt(face)
    depth = depth / centimetre
    to_hair: Any = ndimage.distance_transform_edt(hair_share(r) < _HAIR)
    pieces: Any = ndimage.label(depth > _DEPTH[0])
    labels, count = pieces
    deepest = np.atleast_1d(ndimage.maximum(depth, labels, np.arange(count + 1)))
    deepest[0] = 0
    lit = ramp(light, *_LIGHT) if full > 0 else 1.0
    depth /= 1 + _DOUBT * _unlike(r, depth, centimetre)
    whole = ramp(depth, *_DEPTH) * ramp(to_hair / centimetre, *_HAIR_DEPTH) * lit
    whole *= (deepest > _ISLAND)[labels]
    return whole.astype(np.float32)


def _unlike(r: Reconstruction, depth: np.ndarray, centimetre: float) -> np.ndarray:
    """(S, S) in [0, 1]: how far the tone beside the face is not that of the skin deep within.

    depth: (S, S) cm. Within the landmarks' outline a beard or a scar is the person's own.
    """
    deep = (depth > _DEEP).astype(np.float32) * (1 - features(r, centimetre))
    if not deep.any():
        return np.zeros_like(depth)
    tone = np.log(np.maximum(luminance(r.face.maps.diffuse_albedo), 1e-3))
    typical = np.median(tone[deep > 0.5]) if (deep > 0.5).any() else np.median(tone[deep > 0])
    inside = (depth > 0).astype(np.float32)
    blur = 0.25 * centimetre
    share = ndimage.gaussian_filter(inside, blur)
    tone = ndimage.gaussian_filter((tone - typical) * inside, blur) / np.maximum(share, 1e-6)
    beside = ~filled(r.photo.landmarks[:, :2], len(depth), FACE_OVAL)
    return ramp(np.abs(tone), *_UNLIKE) * beside


def hair_share(r: Reconstruction) -> np.ndarray:
    """(S, S) float32 in [0, 1], how far each pixel of the crop shows hair; 0 where not asked."""
    size = len(r.photo.image)
    if r.photo.regions.shares is None:
        return np.zeros((size, size), np.float32)
    share = r.photo.regions.shares[..., CLASSES.index("hair")]
    return np.clip(cv2.resize(share, (size, size), interpolation=cv2.INTER_CUBIC), 0, 1)


def features(r: Reconstruction, centimetre: float) -> np.ndarray:
    """(S, S) float32 in [0, 1]: brows, lips, eyes and mouth with their rims, softly.

    They are drawn darker or redder than the skin and belong where they are: they neither spread
    nor count as skin. centimetre: its length on the face, pixels.
    """
    regions = r.photo.regions
    drawn = regions.lips + regions.eyes + regions.eyebrows + regions.mouth > 0.3
    away: Any = ndimage.distance_transform_edt(~drawn)
    return (1 - ramp(away / centimetre, 0.5 * _FEATURE_RIM, _FEATURE_RIM)).astype(np.float32)


def squareness(cosine: np.ndarray) -> np.ndarray:
    """What a view at this cosine to the normal is worth, in [0, 1]: it falls smoothly."""
    return ramp(cosine, *_COSINE)


def ramp(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """0 up to `low`, 1 from `high`, smooth between."""
    t = np.clip((values - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
