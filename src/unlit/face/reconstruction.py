"""The result: everything one photo gave, as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..photo.crop import Crop
from ..scene.camera import Camera
from ..scene.light import SphericalGaussians

if TYPE_CHECKING:
    from ..render.relighter import Relighter


@dataclass(frozen=True)
class Fit:
    """What stage 3 holds the mesh to, kept so that a saved result can be continued.

    vertices: (V, 3) float32, the head as fitted before the stages, world frame, cm.
    landmarks: (L, 2) float32, as detected, pixels of the crop. landmark_triangle: (L,) int32,
    landmark_barycentric: (L, 3) float32: the same points on the mesh, -1 where it has none.
    """

    vertices: np.ndarray
    landmarks: np.ndarray
    landmark_triangle: np.ndarray
    landmark_barycentric: np.ndarray


@dataclass(frozen=True)
class Reconstruction:
    """A relightable face. Images are float32 at the crop's size S x S; world frame, cm.

    image: (S, S, 3) the photo's crop, linear sRGB.
    camera: the crop's pinhole camera; crop: where the crop lies in the photo.
    vertices: (V, 3) world frame, cm; triangles: (F, 3) int32, counter-clockwise from outside.
    uv: (T, 2) in [0, 1], v up; triangle_uv: (F, 3) int32 into uv.
    diffuse_albedo: (S, S, 3) linear sRGB. specular_albedo: (S, S), a factor on the Beckmann lobe.
    roughness: (S, S), Beckmann alpha.
    specular_normal, diffuse_normal: (S, S, 3) unit, world frame; zero outside the mask.
    perturbation: (S, S, 3), world frame: what was added to the mesh's normal (stage 4).
    diffuse_shading, specular_shading: (S, S, 3) linear; with the albedos they give `render`. A
    shadow of something else (`lit`) is in them.
    render: (S, S, 3) linear sRGB. mask: (S, S) in [0, 1], where the maps are measured, not
    filled, but for `lit`.
    regions: (S, S, 6) soft masks: skin, lips, eyes, eyebrows, mouth, background.
    light: the 648 spherical Gaussians, and their colour. gain: what albedo was multiplied with, and
    light divided by, after the stages (setting `exposure`). photo_name: the photo's file name.
    settings, metrics: plain values, as saved in reconstruction.toml and metrics.json.
    fit: what the stages started from; None in results saved before it was kept. lit: (S, S) in
    [0, 1], 0 where something else casts a shadow on the face, so that the maps are filled in from
    around; None without such a shadow.
    """

    photo_name: str
    image: np.ndarray
    camera: Camera
    crop: Crop
    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    triangle_uv: np.ndarray
    diffuse_albedo: np.ndarray
    specular_albedo: np.ndarray
    roughness: np.ndarray
    perturbation: np.ndarray
    specular_normal: np.ndarray
    diffuse_normal: np.ndarray
    diffuse_shading: np.ndarray
    specular_shading: np.ndarray
    render: np.ndarray
    mask: np.ndarray
    regions: np.ndarray
    light: SphericalGaussians
    settings: dict[str, Any]
    metrics: dict[str, Any]
    fit: Fit | None = None
    gain: float = 1.0
    lit: np.ndarray | None = None

    @property
    def light_color(self) -> np.ndarray:
        """(3,) linear sRGB of the photo's light; all of its radiance is multiplied by it."""
        return self.light.color

    def relight(self, light: np.ndarray | SphericalGaussians) -> np.ndarray:
        """The face under another light: (S, S, 3) linear sRGB, 0 outside the mask.

        light: radiance as a latitude-longitude map (H, W) or (H, W, 3) in the world frame of
        scene/camera.py, or spherical Gaussians. Deterministic, with self-shadowing and
        inter-reflection.
        """
        return self._relighter(light)

    @cached_property
    def _relighter(self) -> Relighter:
        from ..render.relighter import Relighter

        return Relighter(self)

    def save(self, folder: str | Path) -> None:
        """Write every map, mesh, preview and the montage to `folder`, atomically.

        Raises OutputError when it cannot be written.
        """
        from ..output import save

        save(self, Path(folder))
