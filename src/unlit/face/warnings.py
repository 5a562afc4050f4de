"""What in a photo or a result asks for care, in one sentence each."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..color import encode_srgb
from ..optimize.losses import EXPOSED
from ..settings.conditions import LightColorRequest
from ..settings.settings import Settings
from .reconstruction import Reconstruction

_SHADOW = 0.1  # of the strongest light on the face, which is 1 by convention
_SHADOWED_SHARE = 0.1
_CLIPPED_SHARE = 0.01
_NEAR = 0.995
#: Enlargement of the photo from which it is worth telling.
_ENLARGED = 1.1
#: Of the eye distance: 0.018 to 0.048 on portraits that fitted well (docs/method.md).
_RESIDUAL = 0.055


def findings(r: Reconstruction) -> list[str]:
    """The warnings kept in metrics.json, printed and shown; empty where nothing was found."""
    inside = r.mask > 0
    if not inside.any():
        return ["No pixel was measured: the face is hidden or was not found."]
    photo = encode_srgb(r.image[inside])
    # As in the stages: the best-lit skin has E = 1, and the light no colour.
    albedo = r.diffuse_albedo / np.float32(r.gain)
    shading = r.diffuse_shading * np.float32(r.gain) / r.light.color
    bound = r.settings.get("max_diffuse")
    bound = bound if isinstance(bound, float) else Settings.max_diffuse
    found = [
        _shadowed(_share(shading[inside].mean(axis=1) < _SHADOW)),
        "" if r.lit is None else _cast_shadow(_share(r.lit[inside] < 0.5)),
        _saturated(_share((photo >= EXPOSED[1]).any(axis=1))),
        _crushed(_share((photo <= EXPOSED[0]).all(axis=1))),
        _impossible(_share((r.diffuse_albedo[inside] > 1).any(axis=1))),
        _at_bound(_share((albedo[inside] >= _NEAR * bound).any(axis=1))),
        _small(r, inside),
        _misfit(r.metrics.get("landmark_residual")),
        _light_color(r.metrics.get("light_color")),
        _card(r),
    ]
    return [sentence for sentence in found if sentence]


def _share(where: Any) -> float:
    return float(np.mean(where))


def _shadowed(share: float) -> str:
    if share < _SHADOWED_SHARE:
        return ""
    return (
        f"Shadowed: {share:.0%} of the face gets less than {_SHADOW:.0%} of the strongest light. "
        "There the albedo is a guess from few grey levels."
    )


def _cast_shadow(share: float) -> str:
    return (
        f"Cast shadow: {share:.0%} of the face seems to lie in the shadow of something else (hair, "
        "a hat, a hand). There the maps are filled in from around; if it is the skin itself that "
        "is dark, use --cast-shadows keep."
    )


def _saturated(share: float) -> str:
    if share < _CLIPPED_SHARE:
        return ""
    return (
        f"Saturated: {share:.1%} of the face is as bright as the file can be. Highlights there are "
        "weaker than they were; a darker exposure would help."
    )


def _crushed(share: float) -> str:
    if share < _CLIPPED_SHARE:
        return ""
    return (
        f"Clipped: {share:.1%} of the face is black in the file. It says nothing about the skin "
        "there; a brighter exposure would help."
    )


def _impossible(share: float) -> str:
    if share < _CLIPPED_SHARE:
        return ""
    return (
        f"Bright: the diffuse albedo of {share:.1%} of the face exceeds 1, which no skin does. "
        "What --exposure or --light-color was told does not fit this photo; 8-bit files are "
        "clipped."
    )


def _at_bound(share: float) -> str:
    if share < _CLIPPED_SHARE:
        return ""
    return (
        f"Clipped: the diffuse albedo of {share:.1%} of the face lies at its upper bound. The "
        "light is probably taken for too weak there."
    )


def _small(r: Reconstruction, inside: np.ndarray) -> str:
    columns = np.flatnonzero(inside.any(axis=0))
    width = (columns[-1] - columns[0] + 1) / r.crop.scale
    if r.crop.scale < _ENLARGED:
        return ""
    return (
        f"Small face: it is some {width:.0f} pixels wide in the photo, which was enlarged "
        f"{r.crop.scale:.1f} times. The maps hold no finer detail than that."
    )


def _misfit(residual: Any) -> str:
    if not isinstance(residual, int | float) or residual <= _RESIDUAL:
        return ""
    return (
        f"Large landmark residual: the fitted head misses the landmarks by {residual:.1%} of the "
        "eye distance on average. Look at the mesh; normals and light may be wrong."
    )


def _card(r: Reconstruction) -> str:
    card = LightColorRequest(str(r.settings.get("light_color", "white"))).card
    if card is None:
        return ""
    column, row = np.floor(r.crop.points(card)).astype(int)
    height, width = r.mask.shape
    if not (0 <= row < height and 0 <= column < width and r.mask[row, column] > 0):
        return ""
    return (
        f"Grey card: the photo's pixel {card[0]:g},{card[1]:g} lies on the face, and skin is not "
        "grey. The albedo's colour is wrong unless a card is held there."
    )


def _light_color(found: Any) -> str:
    if not isinstance(found, dict):
        return ""
    kelvin, low, high = (found.get(name) for name in ("kelvin", "low", "high"))
    if not all(isinstance(value, int | float) for value in (kelvin, low, high)):
        return "Light's colour: too little plain skin to tell it; it was taken for white."
    seen = f"the gloss of the skin says {kelvin:.0f} K ({low:.0f} to {high:.0f})"
    if not found.get("used"):
        return f"Light's colour: {seen}, which is not told from white; it was taken for white."
    return (
        f"Light's colour: {seen}, and the albedo was corrected for it. A grey card in the photo "
        "tells it better; light from several lamps of different colours has no single one."
    )
