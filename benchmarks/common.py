"""What the benchmarks share: the default head in front of a portrait camera."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from unlit.head.sources.library import default_model
from unlit.scene.camera import Camera
from unlit.scene.maps import Maps

#: Distance of the face, and width of the crop there, cm.
DISTANCE = 100.0
WIDTH = 26.5


def portrait(size: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, Camera, Maps]:
    """Mean head, triangles, camera, and varied maps with a bumpy normal, `size` x `size`."""
    model = default_model()
    identity = np.zeros(len(model.identity), np.float32)
    vertices = model.vertices(identity, np.zeros(len(model.expression), np.float32))
    middle = np.nanmean(model.landmarks(vertices), axis=0)
    vertices = (vertices - (*middle[:2], middle[2]) - (0, 0, DISTANCE)).astype(np.float32)
    camera = Camera(size, size, size * DISTANCE / WIDTH, size / 2, size / 2)
    rng = np.random.default_rng(seed)

    def noise(sigma: float) -> np.ndarray:
        field = rng.standard_normal((size, size))
        field = ndimage.gaussian_filter(field, sigma * size / 512, mode="wrap")
        return (field / field.std()).astype(np.float32)

    tone = np.array([0.5, 0.32, 0.25], np.float32)
    albedo = tone * np.exp(0.1 * noise(40) + 0.05 * noise(6))[..., None]
    bend = 0.04 * np.stack([noise(3), noise(3), noise(3)], axis=2)
    maps = Maps(
        np.clip(albedo, 0.02, 0.9),
        np.clip(0.9 + 0.1 * noise(50), 0.3, 1.5),
        np.clip(0.3 + 0.02 * noise(30), 0.15, 0.5),
        bend,
    )
    return vertices, model.triangles, camera, maps
