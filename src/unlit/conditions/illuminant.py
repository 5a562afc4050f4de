"""Colours of light: from a temperature, a grey card in the photo, or numbers.

A light's colour is linear sRGB, (3,) float32, its largest channel 1. White is that of sRGB, D65.
"""

from __future__ import annotations

import numpy as np

from ..color import encode_srgb, is_white
from ..errors import SettingsError
from ..photo.photo import Photo
from ..settings.conditions import FAINTEST, HIGHEST, LOWEST, LightColorRequest

_XYZ_TO_SRGB = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
# Side of the square that a grey card's pixel stands for, as a part of the photo's longer side.
_CARD = 0.01
# A photo's brightest: this percentile of its largest channel. Linear, what that is at least in a
# photo that is not dim; and what the dimmest photo's white has.
_BRIGHTEST, _USUAL, _DIMMEST = 99.9, 0.7, 1e-3
#: Encoded values between which a card's colour can be read.
_READABLE = (0.02, 0.99)


def stated(request: LightColorRequest) -> np.ndarray | None:
    """The colour that is said outright; None where a card or an estimate is to tell it."""
    if request.kelvin is not None:
        return of_temperature(request.kelvin)
    return None if request.rgb is None else normalised(np.array(request.rgb), request.text)


def normalised(rgb: np.ndarray, source: str) -> np.ndarray:
    """`rgb` (3,) with the largest channel 1. Raises SettingsError for what is no light's colour."""
    if not (np.isfinite(rgb).all() and rgb.max() > 0 and rgb.min() >= FAINTEST * rgb.max()):
        raise SettingsError(
            f"light_color={source!r}: every channel must be at least {FAINTEST:.0%} of the largest"
        )
    return (rgb / rgb.max()).astype(np.float32)


def of_card(photo: Photo, xy: tuple[float, float]) -> np.ndarray:
    """The light's colour by a grey or white card at `xy`, pixels of the photo.

    The median of a square of 1 % of the photo's longer side. Raises SettingsError where the photo
    cannot tell.
    """
    height, width = photo.pixels.shape[:2]
    at = f"light_color={xy[0]:g},{xy[1]:g}"
    if not (0 <= xy[0] < width and 0 <= xy[1] < height):
        raise SettingsError(f"{at}: outside the photo, which has {width} x {height} pixels")
    reach = max(1, round(_CARD * max(width, height) / 2))
    row, column = int(xy[1]), int(xy[0])
    square = photo.pixels[max(row - reach, 0) : row + reach + 1]
    square = square[:, max(column - reach, 0) : column + reach + 1]
    rgb = np.median(square.reshape(-1, 3), axis=0)
    encoded = encode_srgb(rgb)
    if encoded.min() < _READABLE[0] or encoded.max() > _READABLE[1]:
        raise SettingsError(f"{at}: too dark or too bright there to be read; choose another pixel")
    return normalised(rgb, at.partition("=")[2])


def fitting(color: np.ndarray, face: np.ndarray) -> np.ndarray:
    """`color`, raised as a whole where the face divided by it would not fit below white.

    What lies above white counts as saturated. With the largest channel at 1 that is so for what
    the file has saturated, but under a bluish light it would be so for good red values, too.
    face: (N, 3) linear. White stays white.
    """
    if is_white(color) or not face.size:
        return color
    brightest = float(np.percentile((face / color).max(axis=1), 99))
    return (color * max(brightest, 1.0)).astype(np.float32)


def white_level(photo: Photo) -> float:
    """What white has in `photo`, linear; 1 but in a dim photo.

    What is brightest in a photo that was exposed as photos are is near white, whatever it shows.
    """
    brightest = float(np.percentile(photo.pixels.max(axis=2), _BRIGHTEST))
    return float(np.clip(brightest / _USUAL, _DIMMEST, 1.0))


def of_temperature(kelvin: float) -> np.ndarray:
    """Colour of a light of this temperature: of a black body up to 4,000 K, of daylight (CIE D)
    from 5,000 K on, in between a mixture linear in kelvin, as colour rendering is judged by.
    """
    share = np.clip((kelvin - 4000) / 1000, 0, 1)
    xy = (1 - share) * _black_body(min(kelvin, 5000)) + share * _daylight(max(kelvin, 4000))
    rgb = _XYZ_TO_SRGB @ (xy[0] / xy[1], 1.0, (1 - xy.sum()) / xy[1])
    rgb = np.maximum(rgb, FAINTEST * rgb.max())
    return (rgb / rgb.max()).astype(np.float32)


def temperature(color: np.ndarray) -> float:
    """The temperature whose colour is nearest to `color` in log chromaticity, kelvin."""
    mired = np.arange(1e6 / HIGHEST, 1e6 / LOWEST, 1.0)
    lights = np.log([of_temperature(1e6 / m) for m in mired])
    away = lights - np.log(np.maximum(color, 1e-6))
    away -= away.mean(axis=1, keepdims=True)
    return float(1e6 / mired[np.argmin((away**2).sum(axis=1))])


def _black_body(kelvin: float) -> np.ndarray:
    """CIE 1931 x, y of the Planckian locus, 1,667 to 25,000 K (cubic fit of Kim et al. 2002)."""
    t = 1e3 / kelvin
    if kelvin <= 4000:
        x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.179910
    else:
        x = ((-3.0258469 * t + 2.1070379) * t + 0.2226347) * t + 0.240390
    if kelvin <= 2222:
        y = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683
    elif kelvin <= 4000:
        y = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867
    else:
        y = ((3.0817580 * x - 5.87338670) * x + 3.75112997) * x - 0.37001483
    return np.array([x, y])


def _daylight(kelvin: float) -> np.ndarray:
    """CIE 1931 x, y of the daylight locus, 4,000 to 25,000 K (CIE 15)."""
    t = 1e3 / kelvin
    if kelvin <= 7000:
        x = ((-4.6070 * t + 2.9678) * t + 0.09911) * t + 0.244063
    else:
        x = ((-2.0064 * t + 1.9018) * t + 0.24748) * t + 0.237040
    return np.array([x, (-3 * x + 2.870) * x - 0.275])
