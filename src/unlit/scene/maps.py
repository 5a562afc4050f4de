"""Image-space maps: the textures of the face, one texel per pixel of the crop.

The maps are projected onto the mesh through the camera (paper, section 3.3): the reflectance of a
surface point is the map's value at the pixel the point projects to, whether or not the camera
sees the point. Both renderers use this one rule.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage

from .short_repr import short_repr

#: Standard deviation, in pixels, of the Gaussian that turns the specular normal's perturbation
#: into the diffuse normal's (paper, section 3.4).
DIFFUSE_BLUR = 1.0


@dataclass(frozen=True)
class Maps:
    """Reflectance of a face in the crop's pixels, float32.

    diffuse_albedo: (H, W, 3) linear sRGB, >= 0, up to 1 on skin. specular_albedo: (H, W) >= 0, a
    factor on the Beckmann lobe, of order one. roughness: (H, W), Beckmann alpha in (0, 1).
    perturbation: (H, W, 3), world frame, no unit, added to the mesh's unit normal to give the
    specular normal (paper, equation for n_s); zero for a plain mesh.
    """

    diffuse_albedo: np.ndarray
    specular_albedo: np.ndarray
    roughness: np.ndarray
    perturbation: np.ndarray

    __repr__ = short_repr

    def diffuse_perturbation(self) -> np.ndarray:
        """The perturbation of the diffuse normal, (H, W, 3): the specular one, blurred."""
        return blur(self.perturbation, DIFFUSE_BLUR)

    def with_gain(self, gain: float) -> Maps:
        """Both albedos times `gain`."""
        diffuse, specular = (
            x * np.float32(gain) for x in (self.diffuse_albedo, self.specular_albedo)
        )
        return replace(self, diffuse_albedo=diffuse, specular_albedo=specular)


def kernel(sigma: float) -> np.ndarray:
    """Weights of a Gaussian of standard deviation `sigma` px, cut at 3 sigma, sum 1, float64."""
    radius = int(np.ceil(3 * sigma))
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return weights / weights.sum()


def blur(image: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian blur of (H, W) or (H, W, C) along rows and columns, zero beyond the edges."""
    out = np.asarray(image, dtype=np.float32)
    for axis in (0, 1):
        out = ndimage.convolve1d(out, kernel(sigma), axis=axis, mode="constant")
    return out


def fill(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Copy of `image` (H, W[, C]) with each unknown pixel set to its nearest known one's value.

    known: (H, W) bool. Without any known pixel the image comes back unchanged.
    """
    if not known.any():
        return image.copy()
    nearest: Any = ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    rows, columns = nearest
    return image[rows, columns]
