"""A result in a few lines: what was measured, how well it fits, what it took."""

from __future__ import annotations

import math

from ..conditions.illuminant import temperature
from ..evaluate.metrics import psnr
from ..face.gain import peak_luminance
from ..face.reconstruction import Reconstruction
from ..settings.conditions import AUTO


def facts(r: Reconstruction) -> dict[str, str]:
    """What a report says of a result in a line each, by the name of the line."""
    inside = r.face.mask > 0
    metrics = r.metrics
    found = {
        "Photo": r.photo.name,
        "Crop": f"{r.face.camera.width} x {r.face.camera.height} pixels, each "
        f"{1 / r.photo.crop.scale:.2f} of the photo's",
        "Measured": f"{inside.mean():.0%} of the crop",
        "Field of view": f"{_field_of_view(r):.1f} degrees across the crop",
    }
    if inside.any():
        found["Match"] = (
            f"{psnr(r.images.render, r.photo.image, inside):.1f} dB, re-rendering against photo"
        )
    if (residual := r.head.landmark_residual) is not None:
        found["Landmarks"] = f"missed by {residual:.1%} of the eye distance on average"
    found["Time"] = f"{sum(metrics.seconds.values()):.0f} s without writing the files"
    found["Memory"] = f"{metrics.peak_memory_mb:.0f} MB at most"
    found["Light's colour"] = _light_color(r)
    found["Gain"] = _gain(r)
    found["Mesh"] = f"{len(r.face.mesh.vertices)} vertices, {len(r.face.mesh.triangles)} triangles"
    return found


def _light_color(r: Reconstruction) -> str:
    if r.light.color.min() == r.light.color.max():
        return "taken for white"
    numbers = ", ".join(f"{value:.3f}" for value in r.light.color)
    return f"{numbers} (linear RGB), nearest to {temperature(r.light.color):.0f} K"


def _gain(r: Reconstruction) -> str:
    """What the picture cannot tell, and what was done about it."""
    known = r.settings.exposure.text
    how = f"set by {known}"
    if known == AUTO:
        card = r.light.color.max() / r.gain
        how = f"by convention, a white card in full light would be {card:.2g} times as "
        how += "bright as the photo's white"
    text = f"albedo and light share one gain, which no photo tells: {how}"
    unit = r.photo.white_luminance
    inside = r.face.mask > 0
    if unit is None or not inside.any():
        return text
    lux = math.pi * unit * peak_luminance(r.images.diffuse_shading[inside])
    return f"{text}; by the photo's exposure {lux:,.0f} lux, within a stop or so, fall there"


def _field_of_view(r: Reconstruction) -> float:
    return math.degrees(2 * math.atan(0.5 * r.face.camera.width / r.face.camera.focal))
