"""Lights by name, as relighting takes them, and an evaluation all but the suns.

Azimuth and elevation are degrees in the camera's frame (scene/camera.py), seen from the face:

    d = (sin(azimuth) cos(elevation), sin(elevation), cos(azimuth) cos(elevation))

so (0, 0) is light from the camera, azimuth 90 from the picture's right, -90 from its left, 180
from behind the head; elevation 90 is straight above, whichever way the camera was held.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from ..errors import PictureError, SettingsError
from ..scene.cells import grid_cells
from ..scene.light import disc, flash, uniform
from ..storage.pictures import read_picture

#: Lights that have a name. `side` stands 60 degrees to the picture's right, a little above.
LIGHTS: dict[str, Callable[[], np.ndarray]] = {
    "flash": flash,
    "uniform": uniform,
    "side": lambda: disc((np.sin(np.pi / 3), 0.2, np.cos(np.pi / 3))),
}
FILES = (".hdr", ".exr")
#: The light that was reconstructed.
OWN_LIGHT = "photo"
#: The reconstructed light: a map, or spherical Gaussians.
Own = TypeVar("Own")

_SUN = "sun:"
#: Twice the real sun's half angle, degrees, and a map fine enough for it.
_SUN_HALF_ANGLE, _SUN_MAP = 0.5, (360, 720)
#: Columns of a photographed light at most: a third of a degree.
_WIDEST = 1024


def sun(azimuth: float, elevation: float) -> np.ndarray:
    """Environment map (360, 720) of a distant disc; a white card that faces it renders as 1."""
    a, e = math.radians(azimuth), math.radians(elevation)
    direction = (math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e))
    return disc(direction, 1.0, _SUN_HALF_ANGLE, _SUN_MAP)


def environment_map(text: str, others: tuple[str, ...] = ()) -> np.ndarray:
    """The environment map (H, W) or (H, W, 3) that `text` names.

    One of LIGHTS, sun:AZIMUTH,ELEVATION, or an .hdr or .exr file with a latitude-longitude map,
    whose values are kept as they are but for negative ones, which become 0. others: further names
    for the message. Raises SettingsError for an unknown name, PictureError for a bad file.
    """
    if text in LIGHTS:
        return LIGHTS[text]()
    if text.startswith(_SUN):
        return sun(*_angles(text))
    path = Path(text)
    if path.suffix.lower() not in FILES:
        known = ", ".join((*LIGHTS, *others))
        raise SettingsError(
            f"{text}: no such light; give {known}, sun:AZIMUTH,ELEVATION, or an .hdr or .exr file"
        )
    return np.maximum(read_picture(path), 0)


def requested_light(text: str, own: Own) -> np.ndarray | Own:
    """The light that a user asks to relight with: `own`, the reconstructed one, for OWN_LIGHT.

    Else the environment map (H, W) or (H, W, 3) of `environment_map`, those from files at the
    strength of the named lights (`with_unit_irradiance`).
    """
    if text == OWN_LIGHT:
        return own
    environment = environment_map(text, (OWN_LIGHT,))
    if Path(text).suffix.lower() in FILES:
        return with_unit_irradiance(environment, text)
    return environment


def _angles(text: str) -> tuple[float, float]:
    try:
        azimuth, elevation = map(float, text.removeprefix(_SUN).split(","))
    except ValueError:
        azimuth = elevation = math.nan
    if not (math.isfinite(azimuth) and abs(elevation) <= 90):
        raise SettingsError(
            f"{text}: give sun:AZIMUTH,ELEVATION in degrees, such as sun:-60,30 "
            "(from the picture's left, a third of the way up); elevation -90 to 90"
        )
    return azimuth, elevation


def with_unit_irradiance(environment: np.ndarray, source: str) -> np.ndarray:
    """A photographed light, whose units are arbitrary, scaled to irradiance pi; at most 1024 wide.

    A white card that stands upright and is turned to where it gets most light renders as 1, as it
    does under `flash`, `uniform` and a low sun. This does not change when the light turns about
    the vertical axis. Raises PictureError naming `source` where there is no light.
    """
    height, width = environment.shape[:2]
    if width > _WIDEST:
        size = (_WIDEST, max(1, round(height * _WIDEST / width)))
        environment = cv2.resize(environment, size, interpolation=cv2.INTER_AREA)
    cells = grid_cells(36, 72)
    radiance = cells.average(environment.reshape(*environment.shape[:2], -1).mean(axis=2))
    azimuth = np.arange(72) * (np.pi / 36)
    card = np.stack([np.sin(azimuth), np.zeros(72), np.cos(azimuth)], axis=1)
    brightest = float((np.maximum(card @ cells.moment.T, 0) @ radiance).max()) / np.pi
    if not brightest > 0:
        raise PictureError(f"{source}: black, so nothing would be lit; give another light")
    return (environment / brightest).astype(np.float32)


def turned(environment: np.ndarray, degrees: float) -> np.ndarray:
    """The light turned about the vertical axis: every azimuth grows by `degrees`.

    A light in front moves to the picture's right. Pixels take the mean over their area.
    """
    columns = environment.shape[1] * degrees / 360
    whole = math.floor(columns)
    part = columns - whole
    near, far = (np.roll(environment, -whole - k, axis=1) for k in (0, 1))
    return (near + np.float32(part) * (far - near)).astype(np.float32)
