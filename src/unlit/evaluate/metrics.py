"""Image metrics inside a mask."""

from __future__ import annotations

import numpy as np

from ..color import encode_srgb


def best_gain(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """The one factor on linear `image` (H, W, 3) that brings it nearest to `truth` in `mask`.

    Nearest in encoded values: the light and the albedo of one photo share an unknown gain.
    """
    a, b = image[mask], truth[mask]
    gain = float(b.sum() / max(a.sum(), 1e-12))
    for _ in range(3):
        trial = gain * np.geomspace(0.8, 1.25, 41)
        errors = [np.mean((encode_srgb(a * g) - encode_srgb(b)) ** 2) for g in trial]
        gain = float(trial[int(np.argmin(errors))])
    return gain


def psnr(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Peak signal-to-noise ratio, dB, of sRGB-encoded values clipped to [0, 1], inside `mask`.

    image, truth: (H, W, 3) linear; mask: (H, W) bool.
    """
    a, b = (np.clip(encode_srgb(x[mask]), 0, 1) for x in (image, truth))
    return float(-10 * np.log10(max(np.mean((a - b) ** 2), 1e-12)))


def angle(normals: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Mean angle, degrees, between unit normals (H, W, 3) inside `mask`."""
    cosine = np.clip((normals[mask] * truth[mask]).sum(axis=-1), -1, 1)
    return float(np.degrees(np.arccos(cosine)).mean())
