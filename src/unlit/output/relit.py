"""The face under three lights of a fixed strength, which every overview of a result shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..face.reconstruction import Reconstruction
from ..render.relighter import Relighter
from ..scene.light import RASTER, disc, flash, latlong_directions
from .images import encoded

#: Pictures (S, S, 3) uint8 sRGB by the light's name, black outside the mask.
Relit = dict[str, np.ndarray]


@dataclass(frozen=True)
class NewLight:
    """caption: in words. radiance: makes the environment map (H, W[, 3]), world frame."""

    caption: str
    radiance: Callable[[], np.ndarray]


def outdoors() -> np.ndarray:
    """Environment map (180, 360, 3) of an open sky: blue above, bright horizon, ground, low sun."""
    up = latlong_directions(*RASTER)[..., 1:2]
    zenith, horizon, ground = np.array([[0.35, 0.55, 1.0], [0.9, 0.9, 0.9], [0.22, 0.19, 0.15]])
    sky = horizon + (zenith - horizon) * np.sqrt(np.maximum(up, 0))
    blend = 1 / (1 + np.exp(-up / 0.05))
    sun = disc((-0.6, 0.55, 0.6), irradiance=0.7, half_angle=6)[..., None] * (1.0, 0.86, 0.66)
    return (ground + (sky - ground) * blend + sun).astype(np.float32)


def _from_the_right() -> np.ndarray:
    return disc((np.sin(np.radians(60)), 0.0, np.cos(np.radians(60))))


#: Of a fixed strength, so that faces can be compared: a white card that faces the flash or the
#: side light renders as 1.
LIGHTS = {
    "flash": NewLight("frontal flash", flash),
    "side": NewLight("60 degrees from the right", _from_the_right),
    "outdoors": NewLight("outdoors", outdoors),
}


def relit(r: Reconstruction) -> Relit:
    """The face of `r` under each of LIGHTS, by the deterministic renderer."""
    relighter = Relighter(r.face)
    return {name: encoded(relighter(light.radiance())) for name, light in LIGHTS.items()}
