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
from ..settings.conditions import HIGHEST, LOWEST, LightColorEstimate
from ..settings.settings import Settings
from .first_stage import short_stage1
from .illuminant import of_temperature

# Side of the crop that the settings' lengths are for, pixels.
_SIZE = 256
#: Mired (10^6 / kelvin).
_DAYLIGHT = 1e6 / 6504


@dataclass(frozen=True)
class Slopes:
    """Of ln(R / G) and ln(B / G) over s, (2,), their covariance (2, 2), and k (3,)."""

    value: np.ndarray
    covariance: np.ndarray
    body: np.ndarray


def estimated_color(
    observation: Observation, settings: Settings
) -> tuple[np.ndarray, LightEstimate]:
    """The light's colour (3,), linear sRGB: white where it cannot be told from white."""
    try:
        stage1 = short_stage1(observation, settings)
    except ValueError:  # the head and the mask do not overlap: `solve` says so
        return WHITE.copy(), LightEstimate(used=False)
    how, e, s = settings.light_color_estimate, stage1.diffuse_shading, stage1.specular_shading
    where = _plain_skin(observation, how.margin) & (e > how.least_shading)
    found = slopes(observation.image, e, s, where, how)
    if found is None:
        return WHITE.copy(), LightEstimate(used=False)
    mired, deviation, excess = most_likely(found, how)
    told = abs(mired - _DAYLIGHT) > how.different and excess > how.told
    about = LightEstimate(
        used=bool(told),
        kelvin=float(1e6 / mired),
        low=float(1e6 / (mired + deviation)),
        high=float(1e6 / max(mired - deviation, 1e6 / HIGHEST)),
        excess=float(excess),
    )
    return (of_temperature(1e6 / mired) if told else WHITE.copy()), about


def _plain_skin(observation: Observation, margin: int) -> np.ndarray:
    """(H, W) bool: skin, with a margin to everything else."""
    skin = observation.mask & (observation.regions[..., 0] > 0.9)
    reach = max(1, round(margin * len(skin) / _SIZE))
    return np.asarray(ndimage.binary_erosion(skin, np.ones((3, 3)), iterations=reach))


def slopes(
    image: np.ndarray,
    e: np.ndarray,
    s: np.ndarray,
    where: np.ndarray,
    settings: LightColorEstimate,
) -> Slopes | None:
    """The slopes over s = S / E in the pixels `where` (H, W) bool; None if there are too few.

    image: (H, W, 3) linear; e, s: (H, W) diffuse and specular shading. Differences of albedo over
    long distances, and what follows ln E, are taken out first.
    """
    unit = len(where) / _SIZE
    where = where & (image.min(axis=2) > settings.darkest)
    where &= image.max(axis=2) < settings.brightest
    weight = where.astype(np.float64)

    def mean(values: np.ndarray, deviation: float) -> np.ndarray:
        blurred: Any = ndimage.gaussian_filter(values * weight, deviation * unit)
        share: Any = ndimage.gaussian_filter(weight, deviation * unit)
        return blurred / np.maximum(share, 1e-6)

    rgb = np.stack([mean(image[..., c], settings.blur) for c in range(3)], axis=-1)
    e, s = mean(e, settings.blur), mean(s, settings.blur)
    if where.sum() < settings.least_pixels * unit**2:
        return None
    log = np.log(np.maximum(rgb, 1e-6))

    def fine(values: np.ndarray) -> np.ndarray:
        """Without its local linear trend, at the pixels."""
        low = mean(values, settings.spread)
        return (values - 2 * low + mean(low, settings.spread))[where]

    ratio = s / np.maximum(e, 1e-6)
    known = np.stack([fine(ratio), fine(np.log(np.maximum(e, 1e-6)))], axis=1)
    wanted = np.stack([fine(log[..., c] - log[..., 1]) for c in (0, 2)], axis=1)
    rows, columns = np.nonzero(where)
    count = settings.blocks
    block = rows * count // len(where) * count + columns * count // where.shape[1]
    used, block = np.unique(block, return_inverse=True)
    ridge = 1e-9 * np.eye(2)
    trust = np.ones(len(known))
    for _ in range(settings.reweighted + 1):
        normal, right = np.zeros((len(used), 2, 2)), np.zeros((len(used), 2, 2))
        np.add.at(normal, block, (trust[:, None] * known)[:, :, None] * known[:, None, :])
        np.add.at(right, block, (trust[:, None] * known)[:, :, None] * wanted[:, None, :])
        value = np.linalg.solve(normal.sum(0) + ridge, right.sum(0))
        rest = ((wanted - known @ value) ** 2).sum(axis=1)
        trust = 1 / (1 + rest / (settings.outlier**2 * np.median(rest)))
    value = value[0]
    # Jackknife: without one block at a time.
    without = np.linalg.solve(normal.sum(0) - normal + ridge, right.sum(0) - right)[:, 0]
    away = without - without.mean(axis=0)
    covariance = (len(used) - 1) / len(used) * away.T @ away
    level = np.median((rgb / np.maximum(e, 1e-6)[..., None])[where], axis=0)
    return Slopes(value, covariance, level)


def most_likely(found: Slopes, settings: LightColorEstimate) -> tuple[float, float, float]:
    """The likeliest light, mired, its deviation, and how much less likely white is."""
    mired = np.arange(1e6 / HIGHEST, 1e6 / LOWEST, 1.0)
    light = np.array([of_temperature(1e6 / m) for m in mired], dtype=np.float64)
    share = light / found.body
    expected = share[:, (0, 2)] - share[:, 1:2]  # of rho_s = 1
    covariance = found.covariance + np.eye(2) * settings.systematic**2 * (found.value**2).sum()
    precision = np.linalg.inv(covariance + 1e-12 * np.eye(2))
    gloss = (expected @ precision @ found.value) / np.einsum(
        "ni,ij,nj->n", expected, precision, expected
    )
    rest = found.value - np.maximum(gloss, 0)[:, None] * expected
    misfit = np.einsum("ni,ij,nj->n", rest, precision, rest)
    cost = misfit + ((mired - _DAYLIGHT) / settings.expected) ** 2
    best = int(np.argmin(cost))
    near = mired[cost < cost[best] + 1]
    white = np.interp(_DAYLIGHT, mired, misfit)
    return float(mired[best]), float(np.ptp(near)) / 2, float(white - misfit[best])
