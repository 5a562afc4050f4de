"""A bumpy head under sun and sky whose shadow, colours and albedo are known, for tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
from bumpy_head import bumpy_head, camera
from unlit.conditions.sun_search import Surface
from unlit.face.gain import AlbedoGain
from unlit.optimize.observation import Observation
from unlit.optimize.problem import Problem
from unlit.perception.regions import REGIONS
from unlit.progress.callbacks import silent
from unlit.scene.surface_points import SurfacePoints
from unlit.settings.settings import PRESETS

ABOVE = np.array([0.45, 0.7, 0.55]) / np.linalg.norm([0.45, 0.7, 0.55])
SUN, SKY = np.array([1.0, 0.85, 0.6]), np.array([0.16, 0.19, 0.25])


@dataclass(frozen=True)
class SunHead:
    """observation: as for the stages; problem, surface: of it. unblocked: (S, S, 3), the photo
    without any shadow. visible: (S, S), the sun's share, 1 where it is not faced; faced: bool.
    """

    observation: Observation
    problem: Problem
    surface: Surface
    unblocked: np.ndarray
    visible: np.ndarray
    faced: np.ndarray


def sun_head(size: int, sun: np.ndarray = SUN, brim: float | None = None) -> SunHead:
    """brim: rows above this share of the image lie in shade, too. Noise of 1 %."""
    vertices, triangles = bumpy_head(4)
    everywhere = np.ones((size, size), bool)
    plain = np.zeros((size, size, len(REGIONS)), np.float32)
    plain[..., 0] = 1

    def seen(image: np.ndarray) -> Observation:
        return Observation(
            image.astype(np.float32),
            plain,
            everywhere,
            np.ones((size, size), np.float32),
            everywhere,
            camera(size),
            vertices,
            triangles,
            np.zeros((0, 2), np.float32),
            SurfacePoints.empty(0),
        )

    problem = Problem(seen(np.full((size, size, 3), 0.5)), PRESETS["draft"], AlbedoGain(), silent)
    surface = Surface(problem)
    rng = np.random.default_rng(2)
    freckles = ndimage.gaussian_filter(rng.standard_normal((size, size)), 1.5)
    albedo = np.exp(0.1 * freckles / freckles.std())[..., None] * (0.5, 0.35, 0.28)
    facing = np.maximum(surface.normal @ ABOVE, 0)
    open_ = surface.open(ABOVE[None], 0.005)[0]
    if brim is not None:
        open_ = open_ * (problem.pixel // size > brim * size)

    def image(rows: np.ndarray) -> np.ndarray:
        out = np.zeros((size * size, *rows.shape[1:]), np.float32)
        out[problem.pixel] = rows
        return out.reshape(size, size, *rows.shape[1:])

    noise = 1 + 0.01 * rng.standard_normal((size, size, 1))
    photo = albedo * noise * image((open_ * facing)[:, None] * sun + SKY)
    unblocked = albedo * noise * image(facing[:, None] * sun + SKY)
    observation = seen(photo)
    made = Problem(observation, PRESETS["draft"], AlbedoGain(), silent)
    faced = image((facing > 0.15).astype(np.float32)) > 0
    visible = np.where(faced, image(open_), 1)
    return SunHead(observation, made, Surface(made), unblocked, visible, faced)
