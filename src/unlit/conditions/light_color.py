"""The colour of the light from the gloss of the skin: what is reflected at the surface has it.

In each channel c a pixel is I_c = L_c (a_c E + rho_s S): under the light's colour L the body of the
skin reflects by its albedo a, the surface by rho_s whatever the colour (Shafer 1985). With E and S
from a short stage 1, and s = S / E, wherever the albedo is locally the same

    d ln(I_R / I_G) / ds  =  rho_s (L_R / k_R - L_G / k_G),      k = L a:  I / E without gloss

and so for blue. Both slopes are measured; rho_s is one unknown, and L is another if lights lie on
the locus of black bodies and daylight: two equations, no word about what skin looks like. Ratios of
channels are used because errors of E cancel in them; they leave one line of lights in chromaticity,
which the locus crosses (Finlayson and Schaefer 2001, there without geometry).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from ..color import WHITE
from ..face.conditions import LightEstimate
from ..optimize.observation import Observation
from ..settings.settings import Settings
from .first_stage import first_look
from .illuminant import HIGHEST, LOWEST, of_temperature

# Lengths for a crop of 256 pixels. Slopes are of what is left when means over _SPREAD are taken
# away; pixels nearer than _MARGIN to what is no plain skin are left out; image and model are
# blurred by _BLUR.
_SIZE, _SPREAD, _MARGIN, _BLUR = 256, 14.0, 4, 2.5
#: Diffuse shading below which a pixel is left out, where full light is 1; linear photo values
#: between which it is used.
_DARKEST, _USED = 0.15, (0.003, 0.9)
#: Blocks a side, which are taken as independent of each other.
_BLOCKS = 16
#: Error of the slopes, relative to their size, that the blocks do not show: of S, of the photo's
#: tone curve.
_SYSTEMATIC = 0.05
#: Lights are expected about daylight, in mired (10^6 / kelvin). They are told from white if they
#: differ by so many mired (5,450 to 8,080 K is called white), and if white is so much less likely
#: (difference of squared deviations).
_DAYLIGHT, _EXPECTED, _DIFFERENT, _TOLD = 1e6 / 6504, 200.0, 30.0, 6.0
_LEAST_PIXELS = 500
#: Residuals are weighted by 1 / (1 + (r / (_OUTLIER median))^2): freckles, hairs.
_OUTLIER, _REWEIGHTED = 2.0, 3


@dataclass(frozen=True)
class Slopes:
    """Of ln(R / G) and ln(B / G) over s, (2,), their covariance (2, 2), and k (3,)."""

    value: np.ndarray
    covariance: np.ndarray
    body: np.ndarray


def estimated_color(
    observation: Observation, settings: Settings
) -> tuple[np.ndarray, LightEstimate]:
    """The light's colour (3,): white where the evidence does not tell it from white."""
    try:
        look = first_look(observation, settings)
    except ValueError:  # the head and the mask do not overlap: `solve` says so
        return WHITE.copy(), LightEstimate(used=False)
    e, s = look.diffuse_shading, look.specular_shading
    found = slopes(observation.image, e, s, _plain_skin(observation) & (e > _DARKEST))
    if found is None:
        return WHITE.copy(), LightEstimate(used=False)
    mired, deviation, excess = most_likely(found)
    told = abs(mired - _DAYLIGHT) > _DIFFERENT and excess > _TOLD
    about = LightEstimate(
        used=bool(told),
        kelvin=float(1e6 / mired),
        low=float(1e6 / (mired + deviation)),
        high=float(1e6 / max(mired - deviation, 1e6 / HIGHEST)),
        excess=float(excess),
    )
    return (of_temperature(1e6 / mired) if told else WHITE.copy()), about


def _plain_skin(observation: Observation) -> np.ndarray:
    """(H, W) bool: skin, with a margin to everything else."""
    skin = observation.mask & (observation.regions[..., 0] > 0.9)
    reach = max(1, round(_MARGIN * len(skin) / _SIZE))
    return np.asarray(ndimage.binary_erosion(skin, np.ones((3, 3)), iterations=reach))


def slopes(image: np.ndarray, e: np.ndarray, s: np.ndarray, where: np.ndarray) -> Slopes | None:
    """The slopes over s = S / E in the pixels `where` (H, W) bool; None if there are too few.

    image: (H, W, 3) linear; e, s: (H, W) diffuse and specular shading. Differences of albedo over
    long distances, and what follows ln E, are taken out first.
    """
    unit = len(where) / _SIZE
    where = where & (image.min(axis=2) > _USED[0]) & (image.max(axis=2) < _USED[1])
    weight = where.astype(np.float64)

    def mean(values: np.ndarray, deviation: float) -> np.ndarray:
        blurred: Any = ndimage.gaussian_filter(values * weight, deviation * unit)
        share: Any = ndimage.gaussian_filter(weight, deviation * unit)
        return blurred / np.maximum(share, 1e-6)

    rgb = np.stack([mean(image[..., c], _BLUR) for c in range(3)], axis=-1)
    e, s = mean(e, _BLUR), mean(s, _BLUR)
    if where.sum() < _LEAST_PIXELS * unit**2:
        return None
    log = np.log(np.maximum(rgb, 1e-6))

    def fine(values: np.ndarray) -> np.ndarray:
        """Without its local linear trend, at the pixels."""
        low = mean(values, _SPREAD)
        return (values - 2 * low + mean(low, _SPREAD))[where]

    ratio = s / np.maximum(e, 1e-6)
    known = np.stack([fine(ratio), fine(np.log(np.maximum(e, 1e-6)))], axis=1)
    wanted = np.stack([fine(log[..., c] - log[..., 1]) for c in (0, 2)], axis=1)
    rows, columns = np.nonzero(where)
    block = rows * _BLOCKS // len(where) * _BLOCKS + columns * _BLOCKS // where.shape[1]
    used, block = np.unique(block, return_inverse=True)
    ridge = 1e-9 * np.eye(2)
    trust = np.ones(len(known))
    for _ in range(_REWEIGHTED + 1):
        normal, right = np.zeros((len(used), 2, 2)), np.zeros((len(used), 2, 2))
        np.add.at(normal, block, (trust[:, None] * known)[:, :, None] * known[:, None, :])
        np.add.at(right, block, (trust[:, None] * known)[:, :, None] * wanted[:, None, :])
        value = np.linalg.solve(normal.sum(0) + ridge, right.sum(0))
        rest = ((wanted - known @ value) ** 2).sum(axis=1)
        trust = 1 / (1 + rest / (_OUTLIER**2 * np.median(rest)))
    value = value[0]
    # Jackknife: without one block at a time.
    without = np.linalg.solve(normal.sum(0) - normal + ridge, right.sum(0) - right)[:, 0]
    away = without - without.mean(axis=0)
    covariance = (len(used) - 1) / len(used) * away.T @ away
    level = np.median((rgb / np.maximum(e, 1e-6)[..., None])[where], axis=0)
    return Slopes(value, covariance, level)


def most_likely(found: Slopes) -> tuple[float, float, float]:
    """The likeliest light, mired, its deviation, and how much less likely white is."""
    mired = np.arange(1e6 / HIGHEST, 1e6 / LOWEST, 1.0)
    light = np.array([of_temperature(1e6 / m) for m in mired], dtype=np.float64)
    share = light / found.body
    expected = share[:, (0, 2)] - share[:, 1:2]  # of rho_s = 1
    covariance = found.covariance + np.eye(2) * _SYSTEMATIC**2 * (found.value**2).sum()
    precision = np.linalg.inv(covariance + 1e-12 * np.eye(2))
    gloss = (expected @ precision @ found.value) / np.einsum(
        "ni,ij,nj->n", expected, precision, expected
    )
    rest = found.value - np.maximum(gloss, 0)[:, None] * expected
    misfit = np.einsum("ni,ij,nj->n", rest, precision, rest)
    cost = misfit + ((mired - _DAYLIGHT) / _EXPECTED) ** 2
    best = int(np.argmin(cost))
    near = mired[cost < cost[best] + 1]
    white = np.interp(_DAYLIGHT, mired, misfit)
    return float(mired[best]), float(np.ptp(near)) / 2, float(white - misfit[best])
