"""The truth that reconstructions are held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Truth:
    """What the camera really sees, (H, W[, 3]) float32, 0 where it sees nothing.

    diffuse_albedo: linear sRGB. specular_albedo: factor on the Beckmann lobe. normal: unit, of
    the shaded surface, and position: cm, both in the world frame. seen: bool, pixels that are
    wholly covered.
    """

    diffuse_albedo: np.ndarray
    specular_albedo: np.ndarray
    normal: np.ndarray
    position: np.ndarray
    seen: np.ndarray
