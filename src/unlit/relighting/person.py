"""The whole person in a photo: hair, hat, neck, clothes, and what of it is hair.

The parser knows heads, in crops framed like its own. It is asked about squares of several sizes
around the face; the narrower one's word counts most where it reaches. What all are sure of shows
how person and background look (GrabCut: Rother et al. 2004), which draws the border and goes on
where the parser does not reach. The border's softness is the photo's (guided filter: He et al.
2010).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ..color import encode_srgb
from ..perception.measures import feather
from ..perception.parser import CLASSES, SIZE, parse
from ..photo.crop import Crop
from ..photo.photo import Photo
from ..scene.maps import fill

#: Sides of the squares that the parser is asked about, in sides of the face's crop, and the weight
#: of its word against the wider ones'. Still wider ones are too unlike what it was trained on.
_VIEWS = ((2.2, 1.0), (1.5, 0.75), (1.0, 0.6))
_EDGE = 0.05  # of the crop's side: nearer to the photo's edge the parser is not asked
_FADE = 0.06  # of a square's side, over which its word gives way to the wider one's
#: Side of the square around the face that is looked at, of the crop's, and its pixels at most.
_REACH, _PIXELS = 4.0, 448
#: Where a person goes on beyond that square, over how much of it the new light ends, and over how
#: much its outline becomes that which colours draw in the whole photo.
_ENDING, _SEAM = 0.2, 0.05
_SURE = (0.08, 0.92)  # shares below and above which the parser's word stands
_ROUNDS = 3
#: Radius of the guided filter, of the crop's side, and the variance of sRGB values that is no edge.
_RADIUS, _FLAT = 0.012, 2e-4
_LEVELS = (0.06, 0.94)  # of the filter, that count as none and all
_HAIR = ("hair", "beard", "eyebrows")
_CLOSE = ("skin", "lips", "eyes", "eyebrows", "mouth", "beard", "frame", "tinted lens")


@dataclass(frozen=True)
class Person:
    """A person in a photo of H x W pixels, float32 in [0, 1].

    alpha: (H, W), the share of each pixel that is the person. relit: (H, W), the weight of the new
    light there, which ends softly where the person goes on beyond `square`: what was looked at,
    `side` times as wide as the face's crop. hair, head: (N, N), how far the square's pixels are
    hair or beard, and how far they are the head itself or what lies closely on it. guessed: the
    share of the person that lies beyond the square, where only colours tell it.
    """

    alpha: np.ndarray
    relit: np.ndarray
    square: Crop
    side: float
    hair: np.ndarray
    head: np.ndarray
    guessed: float = 0.0


def around(crop: Crop, side: float, resolution: int) -> Crop:
    """The square with the crop's centre, `side` times as wide, at `resolution` pixels a side."""
    scale = resolution * crop.scale / (crop.resolution * side)
    middle = crop.origin + 0.5 * crop.resolution / crop.scale
    shift = 0.5 * resolution - scale * middle
    return Crop(np.array([[scale, 0, shift[0]], [0, scale, shift[1]]]), resolution)


def resampled(image: np.ndarray, source: Crop, target: Crop, beyond: float = 0.0) -> np.ndarray:
    """`image` (S, S[, C]) of the square `source`, bilinear at the pixels of `target`.

    beyond: what is where `source` does not reach.
    """
    scale = source.scale / target.scale
    shift = source.points(target.origin) + (0.5 * scale - 0.5)
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    size = (target.resolution, target.resolution)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    channels = image.reshape(*image.shape[:2], -1)
    parts = [  # OpenCV's border has four channels at most
        cv2.warpAffine(
            np.ascontiguousarray(channels[..., c]), matrix, size, flags=flags, borderValue=beyond
        )
        for c in range(channels.shape[2])
    ]
    return np.stack(parts, axis=-1).reshape(*size, *image.shape[2:])


def find_person(photo: Photo, crop: Crop, landmarks: np.ndarray) -> Person:
    """The person whose face fills `crop`.

    landmarks: (478, 2 or more), pixels of the crop. Where the photo has an alpha, that is the
    person's, too. Deterministic.
    """
    height, width = photo.pixels.shape[:2]
    points = crop.inverse_points(landmarks[:, :2])
    middle = crop.inverse_points(np.full(2, crop.resolution / 2))
    reach = 2 * np.abs(np.concatenate([middle, (width, height) - middle])).max()
    everything = max(reach / (crop.resolution / crop.scale), 1.0)
    side = min(everything, _REACH)
    whole = around(crop, side, _PIXELS)
    shares, asked = _shares(photo, crop, points, whole)
    radius = max(_RADIUS * _PIXELS / side, 1.0)
    share = 1 - shares[..., 0]
    alpha, found = _matte(photo, points, whole, share, asked, radius)
    relit, guessed = np.ones_like(alpha), 0.0
    if everything > side:
        wide = around(crop, everything, _PIXELS)
        near = _within(_corners(wide, whole), 1.0, _PIXELS)
        share = fill(resampled(found, whole, wide), near)
        beyond, _ = _matte(photo, points, wide, share, near, 1.0)
        near_rim = pasted(_ending(whole, width, height, _SEAM), whole, photo)
        alpha = beyond + near_rim * (alpha - beyond)
        relit = pasted(_ending(whole, width, height, _ENDING), whole, photo)
        outside = pasted(np.ones_like(found), whole, photo) == 0
        guessed = float((alpha * outside).sum() / max(alpha.sum(), 1e-6))
    if photo.alpha is not None:
        alpha = np.minimum(alpha, photo.alpha)

    def of(names: tuple[str, ...]) -> np.ndarray:
        total = shares[..., [CLASSES.index(name) for name in names]].sum(axis=-1)
        return np.clip(feather(total, radius / 2), 0, 1)

    return Person(
        alpha.astype(np.float32), relit, whole, float(side), of(_HAIR), of(_CLOSE), guessed
    )


def _matte(
    photo: Photo,
    points: np.ndarray,
    square: Crop,
    share: np.ndarray,
    asked: np.ndarray,
    radius: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(H, W): how far pixels are the person, 0 beyond `square`; (N, N), 1 on the person, there.

    share: (N, N), the parser's; asked: (N, N) bool, where it is more than the nearest one's.
    points: the landmarks (478, 2), pixels of the photo. radius: of the guided filter, pixels.
    """
    height, width = photo.pixels.shape[:2]
    encoded = np.clip(encode_srgb(square.image(photo.pixels)), 0, 1)
    face = np.zeros(share.shape, np.uint8)
    outline = np.rint(square.points(points)).astype(np.int32)
    cv2.fillConvexPoly(face, cv2.convexHull(outline), 1)
    found = _cut_out(encoded, share, square.inside(width, height), asked, face > 0)
    alpha = _at_full_size(_guided(encoded, found, radius), square, photo)
    low, high = _LEVELS
    return np.clip((alpha - low) / (high - low), 0, 1), found


def _shares(
    photo: Photo, crop: Crop, points: np.ndarray, whole: Crop
) -> tuple[np.ndarray, np.ndarray]:
    """(N, N, 13): shares of CLASSES at the pixels of `whole`, the nearest where nothing was asked.

    And (N, N) bool, where the widest square or more was asked.

    points: the landmarks (478, 2), pixels of the photo.
    """
    height, width = photo.pixels.shape[:2]
    total = np.zeros((whole.resolution, whole.resolution, len(CLASSES)), np.float32)
    total[..., 0] = 1
    for side, trust in _VIEWS:
        view = around(crop, side, 2 * SIZE)
        inside = view.inside(width, height)
        image = np.maximum(view.image(photo.pixels), 0) * inside[..., None]
        found = parse(image, view.points(points), inside)
        place = np.minimum(np.arange(SIZE) + 0.5, SIZE - 0.5 - np.arange(SIZE)) / (_FADE * SIZE)
        ramp = np.clip(place, 0, 1)
        weight = (ramp[:, None] * ramp).astype(np.float32)
        coarse = around(crop, side, SIZE)
        weight, found = (resampled(x, coarse, whole) for x in (weight, found))
        total += trust * weight[..., None] * (found - total)
    # What lies beyond the photo looks like background to the parser, and its neighbours do, too.
    margin = _EDGE * crop.resolution * whole.scale / crop.scale
    corners = whole.points(np.array([[0, 0], [width, height]]))
    known = _within(corners, margin, whole.resolution)
    widest = around(crop, _VIEWS[0][0], SIZE)
    corners = _corners(whole, widest)
    # Its rim has faded to the background that the sum began with.
    asked = _within(corners, 1.3 * _FADE * _VIEWS[0][0] / _EDGE * margin, whole.resolution)
    return fill(total, known & asked), asked


def _corners(square: Crop, other: Crop) -> np.ndarray:
    """(2, 2): the corners of `other` in pixels of `square`."""
    corners = np.array([[0, 0], [other.resolution, other.resolution]])
    return square.points(other.inverse_points(corners))


def _ending(whole: Crop, width: int, height: int, reach: float) -> np.ndarray:
    """(N, N) float32: 1, and 0 at those rims of `whole` beyond which the photo goes on.

    reach: over how much of the square it falls.
    """
    place = np.arange(whole.resolution) + 0.5
    (left, top), (right, bottom) = whole.points(np.array([[0, 0], [width, height]]))

    def ramp(low: float, high: float) -> np.ndarray:
        to_low = place if low < 0 else np.inf
        to_high = whole.resolution - place if high > whole.resolution else np.inf
        near = np.minimum(to_low, to_high) / (reach * whole.resolution)
        return np.clip(np.broadcast_to(near, place.shape), 0, 1)

    share = ramp(top, bottom)[:, None] * ramp(left, right)
    return (share * share * (3 - 2 * share)).astype(np.float32)


def _within(corners: np.ndarray, margin: float, size: int) -> np.ndarray:
    """(N, N) bool: pixels further than `margin` inside the rectangle of two corners (2, 2)."""
    place = np.arange(size) + 0.5
    (left, top), (right, bottom) = corners
    across = (place > left + margin) & (place < right - margin)
    down = (place > top + margin) & (place < bottom - margin)
    return down[:, None] & across


def _cut_out(
    encoded: np.ndarray,
    share: np.ndarray,
    inside: np.ndarray,
    asked: np.ndarray,
    face: np.ndarray,
) -> np.ndarray:
    """(N, N) float32, 1 on the person: what the parser's `share` (N, N) and the colours say.

    face: (N, N) bool, what the landmarks enclose. Beyond the photo, `inside` (N, N) bool, the
    nearest pixel's.
    """
    rows, columns = (np.flatnonzero(inside.any(axis=k)) for k in (1, 0))
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    share = feather(share[part], 1.0)
    low, high = _SURE
    label = np.where(share > 0.5, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    label[share < low] = cv2.GC_BGD
    label[share > high] = cv2.GC_FGD
    beyond = ~asked[part]
    label[beyond] = np.where(share > 0.5, cv2.GC_PR_FGD, cv2.GC_PR_BGD)[beyond]
    person = (label & 1) == 1
    if person.any() and not person.all():
        picture = np.round(255 * encoded[part][..., ::-1]).astype(np.uint8)
        cv2.setRNGSeed(0)
        models = (np.zeros((1, 65)), np.zeros((1, 65)))
        picture = np.ascontiguousarray(picture)
        cv2.grabCut(picture, label, None, *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
        person = _whole((label & 1) == 1, face[part])
    padding = [(s.start, len(inside) - s.stop) for s in part]
    return np.pad(person, padding, mode="edge").astype(np.float32)


def _whole(person: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(h, w) bool: the piece of `person` with most of the face, without small holes.

    Of pieces with none of it, the largest.
    """
    _, parts, table, _ = cv2.connectedComponentsWithStats(person.astype(np.uint8))
    if len(table) < 2:
        return person
    of_face = np.bincount(parts[face], minlength=len(table))[1:]
    person = parts == 1 + int(np.lexsort((table[1:, cv2.CC_STAT_AREA], of_face))[-1])
    holes = ~person & np.asarray(ndimage.binary_fill_holes(person))
    _, parts, table, _ = cv2.connectedComponentsWithStats(holes.astype(np.uint8))
    small = np.flatnonzero(table[:, cv2.CC_STAT_AREA] < 1e-3 * person.size)
    return person | (holes & np.isin(parts, small))


def _guided(guide: np.ndarray, target: np.ndarray, radius: float) -> np.ndarray:
    """(N, N, 4): the guided filter's a and b, target = a . guide + b; guide (N, N, 3)."""
    size = (2 * round(radius) + 1,) * 2

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.blur(values, size, borderType=cv2.BORDER_REFLECT)

    guide = guide.astype(np.float32)
    middle, level = mean(guide), mean(target)
    together = mean(guide * target[..., None]) - middle * level[..., None]
    square = np.stack([mean(guide * guide[..., [k]]) for k in range(3)], axis=-1)
    spread = square - middle[..., :, None] * middle[..., None, :] + _FLAT * np.eye(3)
    slope = np.linalg.solve(spread, together[..., None])[..., 0]
    start = level - (slope * middle).sum(axis=-1)
    return mean(np.concatenate([slope, start[..., None]], axis=-1).astype(np.float32))


def _at_full_size(line: np.ndarray, whole: Crop, photo: Photo) -> np.ndarray:
    """(H, W): the guided filter's result at the photo's own pixels."""
    coefficients = pasted(line, whole, photo)
    encoded = np.clip(encode_srgb(photo.pixels), 0, 1)
    return (coefficients[..., :3] * encoded).sum(axis=-1) + coefficients[..., 3]


def pasted(values: np.ndarray, whole: Crop, photo: Photo) -> np.ndarray:
    """(H, W[, C]): values (N, N[, C]) of the square `whole` at the photo's pixels, 0 beyond it."""
    channels = values.reshape(*values.shape[:2], -1)
    empty = np.zeros((*photo.pixels.shape[:2], channels.shape[2]), np.float32)
    out = whole.paste(channels, empty, np.ones(values.shape[:2], np.float32))
    return out.reshape(*photo.pixels.shape[:2], *values.shape[2:])
