"""What in a photo or a result asks for care, in one sentence each."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..color import UNCLIPPED, encode_srgb
from ..perception.covers import worn
from .conditions import LightEstimate, Shadow
from .photo import FacePhoto
from .reconstruction import Reconstruction

_SHADOW = 0.1  # of the strongest light on the face, which is 1 by convention
_SHADOWED_SHARE = 0.1
_CLIPPED_SHARE = 0.01
_NEAR = 0.995
#: Enlargement of the photo from which it is worth telling.
_ENLARGED = 1.1
#: Of the eye distance: 0.018 to 0.048 on portraits that fitted well
#: (docs/lab/method-notes-results.md, 12.7).
_RESIDUAL = 0.055

# What is told of a share of the face.
_SHADOWED = (
    f"Shadowed: {{:.0%}} of the face gets less than {_SHADOW:.0%} of the strongest light. "
    "There the level of the albedo is a guess, and its detail has few grey levels."
)
_CAST_SHADOW = (
    "Cast shadow: {:.0%} of the face seems to lie in the shadow of something else (hair, "
    "a hat, a hand), which is taken out of the maps; if it is the skin itself that is dark, set "
    "cast_shadow.mode to keep."
)
_SUN = (
    "Sun: one small light was found, {:.0f} degrees up and {:.0f} to the {} as the camera sees it. "
    "Its shadow, on {:.0%} of the face, and the other colour of the shade are taken out of the "
    "maps; if there is none, use --sun never."
)
_SATURATED = (
    "Saturated: {:.1%} of the face is as bright as the file can be. Highlights there are "
    "weaker than they were; a darker exposure would help."
)
_CRUSHED = (
    "Clipped: {:.1%} of the face is black in the file. It says nothing about the skin "
    "there; a brighter exposure would help."
)
_IMPOSSIBLE = (
    "Bright: the diffuse albedo of {:.1%} of the face exceeds 1, which no skin does. "
    "What exposure or light_color was told does not fit this photo; 8-bit files are "
    "clipped."
)
_AT_BOUND = (
    "Clipped: the diffuse albedo of {:.1%} of the face lies at its upper bound. The "
    "light is probably taken for too weak there."
)

_TINT = (
    "Tint: the light's colour changes over the face, red against blue by {:.0%}, which was taken "
    "out of the maps. If it is paint or make-up on one half, use --set tint.mode=never."
)

#: What covers the face; the share is that of `covers`.
_COVERS = {
    "tinted glasses": "Tinted glasses: the eyes and the skin behind them are not measured; there "
    "the maps are filled in.",
    "glasses": "Glasses: their frames are left out. Skin behind clear lenses counts as skin, with "
    "what the glass reflects.",
    "beard": "Beard: it covers {:.0%} of the face below the nose. There the maps are filled in "
    "from around.",
    "hair": "Hair: it covers {:.0%} of the forehead. There the maps are filled in from around.",
    "hat": "Hat: what it covers is filled in, and its shadow may stay in the albedo.",
    "hand or cloth": "Hand or cloth: it seems to cover {:.0%} of the face. There the maps are "
    "filled in from around.",
}


def warnings(r: Reconstruction) -> tuple[str, ...]:
    """The warnings kept in metrics.json, printed and shown; empty where nothing was found."""
    inside = r.face.mask > 0
    if not inside.any():
        return ("No pixel was measured: the face is hidden or was not found.",)
    photo = encode_srgb(r.photo.image[inside])
    diffuse = r.face.maps.diffuse_albedo
    # As in the stages: the best-lit skin has E = 1, and the light no colour.
    albedo = diffuse / np.float32(r.gain)
    shading = r.images.diffuse_shading * np.float32(r.gain) / r.light.color
    bound = _NEAR * r.settings.max_diffuse
    found = (
        _of_share(_SHADOWED, shading[inside].mean(axis=1) < _SHADOW, _SHADOWED_SHARE),
        _shadow(r.conditions.shadow, inside),
        _tint(r.conditions.tint, inside),
        _of_share(_SATURATED, (photo >= UNCLIPPED[1]).any(axis=1)),
        _of_share(_CRUSHED, (photo <= UNCLIPPED[0]).all(axis=1)),
        _of_share(_IMPOSSIBLE, (diffuse[inside] > 1).any(axis=1)),
        _of_share(_AT_BOUND, (albedo[inside] >= bound).any(axis=1)),
        _small(r.photo.crop.scale, inside),
        _misfit(r.head.landmark_residual),
        _light_color(r.conditions.light_estimate),
        _card(r),
        *_covered(r.photo),
    )
    return tuple(sentence for sentence in found if sentence)


def _covered(photo: FacePhoto) -> list[str]:
    shares = photo.regions.shares
    if shares is None:
        return []
    found = worn(shares, photo.landmarks[:, :2], len(photo.image))
    return [text.format(found[name]) for name, text in _COVERS.items() if name in found]


def _of_share(sentence: str, where: ArrayLike, least: float = _CLIPPED_SHARE) -> str:
    """`sentence` with the share of the face that `where` marks, if it is `least` or more."""
    share = float(np.asarray(where).mean())
    return sentence.format(share) if share >= least else ""


def _shadow(shadow: Shadow | None, inside: np.ndarray) -> str:
    if shadow is None:
        return ""
    dark = shadow.visibility[inside] < 0.5
    if shadow.sun is None:
        return _of_share(_CAST_SHADOW, dark, 0)
    x, y, z = (float(part) for part in shadow.sun)
    up, aside = np.degrees(np.arcsin(np.clip(y, -1, 1))), np.degrees(np.arctan2(x, z))
    side = "right" if aside >= 0 else "left"
    return _SUN.format(up, abs(aside), side, float(dark.mean()))


def _tint(tint: np.ndarray | None, inside: np.ndarray) -> str:
    if tint is None:
        return ""
    warmer, cooler = np.percentile(tint[inside, 0] / tint[inside, 2], (95, 5))
    return _TINT.format(float(warmer / cooler) - 1)


def _small(scale: float, inside: np.ndarray) -> str:
    columns = np.flatnonzero(inside.any(axis=0))
    width = (columns[-1] - columns[0] + 1) / scale
    if scale < _ENLARGED:
        return ""
    return (
        f"Small face: it is some {width:.0f} pixels wide in the photo, which was enlarged "
        f"{scale:.1f} times. The maps hold no finer detail than that."
    )


def _misfit(residual: float | None) -> str:
    if residual is None or residual <= _RESIDUAL:
        return ""
    return (
        f"Large landmark residual: the fitted head misses the landmarks by {residual:.1%} of the "
        "eye distance on average. Look at the mesh; normals and light may be wrong."
    )


def _card(r: Reconstruction) -> str:
    card = r.settings.light_color.card
    if card is None:
        return ""
    column, row = np.floor(r.photo.crop.points(card)).astype(int)
    height, width = r.face.mask.shape
    if not (0 <= row < height and 0 <= column < width and r.face.mask[row, column] > 0):
        return ""
    return (
        f"Grey card: the photo's pixel {card[0]:g},{card[1]:g} lies on the face, and skin is not "
        "grey. The albedo's colour is wrong unless a card is held there."
    )


def _light_color(found: LightEstimate | None) -> str:
    if found is None:
        return ""
    if found.kelvin is None:
        return "Light's colour: too little plain skin to tell it; it was taken for white."
    seen = f"the gloss of the skin says {found.kelvin:.0f} K ({found.low:.0f} to {found.high:.0f})"
    if not found.used:
        return f"Light's colour: {seen}, which is not told from white; it was taken for white."
    return (
        f"Light's colour: {seen}, and the albedo was corrected for it. A grey card in the photo "
        "tells it better; light from several lamps of different colours has no single one."
    )
