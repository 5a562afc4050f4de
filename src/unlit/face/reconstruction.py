"""The result: everything one photo gave, as NumPy arrays. Pure data; functions work on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.light import SphericalGaussians
from ..scene.short_repr import short_repr
from ..settings.settings import Settings
from .conditions import Conditions
from .face import Face
from .head import FittedHead
from .photo import FacePhoto


@dataclass(frozen=True)
class Images:
    """What the face looks like in the photo's light, (S, S, 3) float32 linear sRGB, >= 0.

    diffuse_shading, specular_shading: irradiance over pi, and the unit lobe's reflection; times
    the albedos they give `render`. The shadow of something else is in all three.
    """

    diffuse_shading: np.ndarray
    specular_shading: np.ndarray
    render: np.ndarray

    __repr__ = short_repr


@dataclass(frozen=True)
class Metrics:
    """How a run went.

    losses: (iteration, loss) pairs by stage. seconds: by step. peak_memory_mb: of the process, MB.
    warnings: one sentence each. continued_from_stage: the first stage that was run again.
    """

    losses: dict[str, list[tuple[int, float]]]
    seconds: dict[str, float]
    peak_memory_mb: float
    warnings: tuple[str, ...] = ()
    continued_from_stage: int | None = None

    __repr__ = short_repr


@dataclass(frozen=True)
class Reconstruction:
    """A relightable face, and the photo's light.

    photo: what the photo shows. head: what the stages started from. face: what belongs to the
    person. light: 648 spherical Gaussians and their colour; conditions: what else belongs to the
    moment. images: both together. gain: what albedo was multiplied with, and light divided by,
    after the stages (setting `exposure`); above 0.
    """

    photo: FacePhoto
    head: FittedHead
    conditions: Conditions
    face: Face
    light: SphericalGaussians
    images: Images
    gain: float
    settings: Settings
    metrics: Metrics

    def __repr__(self) -> str:
        size, lobes = len(self.photo.image), len(self.light.sharpness)
        mesh = self.face.mesh
        return (
            f"{type(self).__name__}({self.photo.name!r}: {size} x {size} pixels, "
            f"{len(mesh.vertices):,} vertices, {lobes} lobes of light)"
        )
