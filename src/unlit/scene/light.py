"""The light: a mixture of spherical Gaussians of one colour (paper, section 2.3), and its raster.

    L(w) = c sum_k mu_k exp(lambda_k (w . xi_k - 1)),   k = 1..648

Directions are in the world frame of `camera.py`. Radiance is in the units of the photo's linear
values: a white Lambertian surface (albedo 1) under irradiance E / pi = 1 renders as 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..color import is_white
from .short_repr import short_repr

#: The environment map's size (rows, columns), and the lobes' starting grid (paper, section 2.3).
RASTER = (180, 360)
GRID = (18, 36)


def latlong_directions(height: int, width: int) -> np.ndarray:
    """Unit directions (height, width, 3), float64, of a latitude-longitude map's pixel centres."""
    theta = (np.arange(height) + 0.5) * (np.pi / height)
    phi = (np.arange(width) + 0.5) * (2 * np.pi / width)
    sine = np.sin(theta)[:, None]
    return np.stack(
        [
            np.sin(phi) * sine,
            np.broadcast_to(np.cos(theta)[:, None], (height, width)),
            -np.cos(phi) * sine,
        ],
        axis=-1,
    )


def latlong_solid_angles(height: int, width: int) -> np.ndarray:
    """Exact solid angle (height, width), steradian, of each latitude-longitude pixel."""
    edges = np.cos(np.arange(height + 1) * (np.pi / height))
    return np.repeat((edges[:-1] - edges[1:])[:, None] * (2 * np.pi / width), width, axis=1)


def coloured(environment: np.ndarray) -> np.ndarray:
    """(H, W, 3) radiance of an environment map that has colours, or (H, W) is grey."""
    return environment if environment.ndim == 3 else environment[..., None].repeat(3, axis=2)


@dataclass(frozen=True)
class SphericalGaussians:
    """Lobes: unit axis (K, 3), sharpness (K,) > 0, amplitude (K,) >= 0 radiance; float32.

    color: (3,) linear sRGB, > 0, that all radiance is multiplied with; the optimiser's light is
    white.
    """

    axis: np.ndarray
    sharpness: np.ndarray
    amplitude: np.ndarray
    color: np.ndarray = field(default_factory=lambda: np.ones(3, dtype=np.float32))

    __repr__ = short_repr

    def radiance(self, directions: np.ndarray) -> np.ndarray:
        """Radiance from unit `directions` (..., 3), float32: (...,), or (..., 3) if not white."""
        flat = np.asarray(directions, dtype=np.float32).reshape(-1, 3)
        out = np.empty(len(flat), dtype=np.float32)
        axis = self.axis.astype(np.float32).T
        for start in range(0, len(flat), 4096):  # bounds memory: K x 4096 floats
            part = slice(start, start + 4096)
            out[part] = np.exp(self.sharpness * (flat[part] @ axis - 1)) @ self.amplitude
        grey = out.reshape(np.shape(directions)[:-1])
        return grey if is_white(self.color) else grey[..., None] * self.color

    def rasterize(self, height: int = RASTER[0], width: int = RASTER[1]) -> np.ndarray:
        """Environment map (height, width[, 3]), float32 radiance at the pixel centres."""
        return self.radiance(latlong_directions(height, width))

    @cached_property
    def environment(self) -> np.ndarray:
        """`rasterize()` when first asked for, then kept; not to be written to."""
        return self.rasterize()

    def scaled(self, gain: float) -> SphericalGaussians:
        """The same light times `gain`."""
        return replace(self, amplitude=self.amplitude * np.float32(gain))


def grid_lobes(
    sharpness: float, radiance: float, grid: tuple[int, int] = GRID
) -> SphericalGaussians:
    """Lobes on the centres of a latitude-longitude grid that sum to a near-uniform `radiance`.

    On such a grid lobes crowd at the poles, so each amplitude is proportional to its cell's solid
    angle.
    """
    axis = latlong_directions(*grid).reshape(-1, 3)
    omega = latlong_solid_angles(*grid).reshape(-1)
    lobe = 2 * np.pi / sharpness * -np.expm1(-2 * sharpness)
    return SphericalGaussians(
        axis.astype(np.float32),
        np.full(len(axis), sharpness, dtype=np.float32),
        (radiance * omega / lobe).astype(np.float32),
    )


def flash(irradiance: float = 1.0, half_angle: float = 2.5) -> np.ndarray:
    """Environment map (180, 360) of a small disc of light seen at the camera.

    `irradiance` is E / pi on a surface that faces the camera: a white card renders as this value.
    `half_angle` in degrees.
    """
    return disc((0.0, 0.0, 1.0), irradiance, half_angle)


def disc(
    direction: tuple[float, float, float] | np.ndarray,
    irradiance: float = 1.0,
    half_angle: float = 2.5,
    size: tuple[int, int] = RASTER,
) -> np.ndarray:
    """Environment map `size` of one disc of light around `direction`, edge anti-aliased.

    `irradiance` is E / pi on a surface that faces it; `half_angle` in degrees.
    """
    fine = 4
    axis = np.asarray(direction, dtype=np.float64)
    axis = axis / np.linalg.norm(axis)
    height, width = size
    inside = latlong_directions(height * fine, width * fine) @ axis > np.cos(np.radians(half_angle))
    mask = inside.reshape(height, fine, width, fine).mean(axis=(1, 3))
    directions = latlong_directions(height, width)
    cosine = np.maximum(directions @ axis, 0)
    flux = (mask * cosine * latlong_solid_angles(height, width)).sum()
    return (mask * (np.pi * irradiance / flux)).astype(np.float32)


def uniform(radiance: float = 1.0) -> np.ndarray:
    """Constant environment map (180, 360): E / pi = radiance on an unoccluded surface."""
    return np.full(RASTER, radiance, dtype=np.float32)
