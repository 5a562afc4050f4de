"""Peak signal-to-noise ratio: how far a picture is from what it should show."""

from __future__ import annotations

import numpy as np

from ..color import encode_srgb


def psnr(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Peak signal-to-noise ratio, dB, of sRGB-encoded values clipped to [0, 1], inside `mask`.

    image, truth: (H, W, 3) linear; mask: (H, W) bool.
    """
    return psnr_linear(encode_srgb(image), encode_srgb(truth), mask)


def psnr_linear(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """The same of the values as they are, clipped to [0, 1]."""
    a, b = (np.clip(x[mask], 0, 1).astype(np.float64) for x in (image, truth))
    return float(-10 * np.log10(max(np.mean((a - b) ** 2), 1e-12)))
