"""Random heads of the default head model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unlit.head.model import VERTEX_REGIONS
from unlit.head.sources.library import default_model
from unlit.scene.normals import vertex_normals


@dataclass(frozen=True)
class Head:
    """A head in its own frame (head/model.py): x to the subject's left, y up, facing +z, cm.

    vertices (V, 3), triangles (F, 3), region (V,) uint8 as in VERTEX_REGIONS, landmarks (478, 3).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    region: np.ndarray
    landmarks: np.ndarray

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit vertex normals (V, 3)."""
        return vertex_normals(self.vertices, self.triangles)

    def within(self, *regions: str) -> np.ndarray:
        """(V,) bool: the vertices of those regions."""
        return np.isin(self.region, [VERTEX_REGIONS.index(name) for name in regions])

    def outer(self) -> np.ndarray:
        """(V,) bool: of the surface that clothes touch: without eyes, mouth and teeth."""
        return ~self.within("eyes", "mouth", "teeth")

    def point(self, *landmarks: int) -> np.ndarray:
        """Mean (3,) of some landmarks."""
        return np.nanmean(self.landmarks[list(landmarks)], axis=0)


#: Expressions that photos show, as strengths of the model's units.
EXPRESSIONS = {
    "none": {},
    "smile": {"mouthSmile": 0.7, "cheekSquint": 0.4},
    "laugh": {"mouthSmile": 0.8, "jawOpen": 0.25, "cheekSquint": 0.6, "mouthUpperUp": 0.4},
    "talk": {"jawOpen": 0.2},
    "frown": {"browDown": 0.8, "mouthFrown": 0.4},
    "squint": {"eyeSquint": 0.9, "browDown": 0.4},
    "surprise": {"browInnerUp": 0.8, "browOuterUp": 0.8, "jawOpen": 0.3, "eyeWide": 0.7},
    "asleep": {"eyeBlink": 1.0},
}


def random_head(rng: np.random.Generator, expression: str = "none", spread: float = 0.8) -> Head:
    """A random person; spread: standard deviations of each component."""
    model = default_model()
    identity = rng.standard_normal(len(model.identity)) * spread
    strengths = np.zeros(len(model.expression))
    units = EXPRESSIONS[expression]
    for k, name in enumerate(model.expression_names):
        unit = name.removesuffix("Left").removesuffix("Right")
        strengths[k] = units.get(unit, 0.0) * rng.uniform(0.6, 1.1)
    vertices = model.vertices(identity, np.clip(strengths, 0, 1)).astype(float)
    return Head(vertices, model.triangles, model.vertex_region, model.landmarks(vertices))
