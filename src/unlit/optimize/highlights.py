"""Highlights that the stages left in the diffuse albedo, told by their colour and place.

Gloss has one level after stage 1 and is smooth after the others; what a face shines more than that
stays in the diffuse albedo. But what is reflected at the surface has the light's colour, white
here, and adds to the body's (Shafer 1985). With c, the colour that the body of the skin has around
a pixel, its albedo is

    a = k c + h (1, 1, 1)

and h is a highlight as far as the pixel is brighter than the skin around by as much, too. It goes
to the specular albedo, as far as the light leaves a highlight there:

    rho_d' = a - h,      rho_s' = rho_s + h E / S

so that the rendered image stays as it is. Pale and dark spots of pigment are kept: freckles are
darker, and what is pale but no brighter, or where no more is mirrored than all over the face, is
none. So is what is seen at a grazing angle, where S changes more than the mesh is sure of.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

from ..color import luminance
from ..perception.regions import REGIONS
from ..settings.detail import FineDetail
from .problem import Problem
from .relief import pixel_frames

#: Parts with one colour of body each, and the share of a pixel that belongs there.
_PARTS, _SURE = ("skin", "lips"), 0.9
#: E, where the best-lit skin has 1, from which a pixel fully tells the body's colour.
_LIT = 0.15
#: Width of the image in which that colour is looked for, and of the crop that lengths are for.
_COARSE, _WIDTH = 256, 512
#: How much whiter or more colourful than the skin around a pixel is that counts half for it.
_DOUBT = 0.08
_REWEIGHTED = 6
#: How much the part as a whole says where little of it is near.
_FAR = 0.02
#: S over E, of its median over the part, at which half of what looks like a highlight is one: where
#: a soft light is mirrored alike all over the face, none can be told from pale skin.
_MIRRORED = 2.0
#: Of the albedo's weakest channel, what is left at least.
_BODY = 0.1
_LEAST = 1e-3


def with_highlights(
    problem: Problem,
    albedo: np.ndarray,
    specular: np.ndarray,
    e: np.ndarray,
    s: np.ndarray,
    settings: FineDetail,
) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse (P, 3) and specular albedo (P,), the highlights taken from the one to the other.

    albedo: (P, 3) diffuse. specular: (P,). e, s: (P, 3) diffuse and specular shading, where the
    best-lit skin has E = 1.
    """
    level = e.mean(axis=1)
    mirrored = np.maximum(s.mean(axis=1), 0) / np.maximum(level, _LEAST)
    found = np.zeros(len(albedo))
    for part in _PARTS:
        inside = problem.regions[:, REGIONS.index(part)] > _SURE
        told = inside & (albedo.min(axis=1) > _LEAST) & (problem.weight.numpy() > 0)
        weight = told * np.clip(level / _LIT, 0, 1) ** 2
        lit = told & (level > _LIT)
        if lit.any():
            usual = _MIRRORED * np.median(mirrored[lit])
            share = 1 / (1 + (usual / np.maximum(mirrored, _LEAST)) ** 2)
            found += told * share * _highlight(problem, albedo, weight, settings)
    found = found * pixel_frames(problem).trust
    # The bound is soft, so that the map keeps its shape where the light leaves little room.
    most = np.maximum(settings.highlight_most * mirrored, 1e-9)
    found = most * -np.expm1(-found / most)
    found = np.minimum(found, (1 - _BODY) * albedo.min(axis=1))
    more = found / np.maximum(mirrored, _LEAST)
    specular = np.minimum(specular + more, problem.settings.max_specular)
    return (albedo - found[:, None]).astype(np.float32), specular.astype(np.float32)


def _highlight(
    problem: Problem, albedo: np.ndarray, weight: np.ndarray, settings: FineDetail
) -> np.ndarray:
    """(P,) h >= 0 of albedo (P, 3). weight: (P,) of the pixels that tell the body's colour."""
    image, share = problem.image_of(albedo), problem.image_of(weight)
    body = problem.rows(body_around(image, share, settings))
    around, brightness = luminance(body), luminance(albedo)
    white = _white_share(albedo, body / np.maximum(around, _LEAST)[:, None])
    margin = settings.highlight_margin * around
    return np.maximum(np.minimum(white, brightness - around) - margin, 0)


def _white_share(albedo: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """(...,) h of albedo (..., 3) = k colour + h, by least squares."""
    square, total = (colour**2).sum(axis=-1), colour.sum(axis=-1)
    along, across = (albedo * colour).sum(axis=-1), albedo.sum(axis=-1)
    # Where the colour is white itself, nothing can be told.
    return (square * across - total * along) / np.maximum(3 * square - total**2, 1e-4)


def body_around(image: np.ndarray, weight: np.ndarray, settings: FineDetail) -> np.ndarray:
    """(H, W, 3) what the albedo is around each pixel, highlights left out.

    image: (H, W, 3) diffuse albedo. weight: (H, W), 0 where it says nothing. A weighted mean of
    logarithms by a Gaussian of `settings.highlight_length`; what is whiter than it or more
    colourful counts less, so that most of the skin around says what its colour is.
    """
    height, width = weight.shape
    size = (min(width, _COARSE), min(height, round(height * min(1, _COARSE / width))))
    share = cv2.resize(weight.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    small = cv2.resize(
        (image * weight[..., None]).astype(np.float32), size, interpolation=cv2.INTER_AREA
    )
    small = np.maximum(small / np.maximum(share, 1e-6)[..., None], _LEAST)
    sigma = settings.highlight_length * size[0] / _WIDTH
    logs, counts = np.log(small), share.copy()
    body = small
    for _ in range(_REWEIGHTED):
        near = ndimage.gaussian_filter(counts, sigma) + _FAR * counts.mean()
        mean = [
            (ndimage.gaussian_filter(x * counts, sigma) + _FAR * (x * counts).mean()) / near
            for x in np.moveaxis(logs, -1, 0)
        ]
        body = np.exp(np.stack(mean, axis=-1))
        around = luminance(body)
        white = _white_share(small, body / around[..., None])
        counts = share / (1 + (white / (_DOUBT * around)) ** 2)
    return np.asarray(cv2.resize(body, (width, height), interpolation=cv2.INTER_LINEAR))
