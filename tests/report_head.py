"""The small head with what a report shows besides maps: a photo, shading, metrics, settings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from small_head import small_head
from unlit.face.reconstruction import Reconstruction

METRICS = {
    "landmark_residual": 0.02,
    "losses": {"stage1": [[0, 0.5], [25, 0.05], [50, 0.02]], "stage2": [[0, 0.1], [10, 0.1]]},
    "seconds": {"photo": 0.5, "stage1": 12.25},
    "peak_memory_mb": 700.0,
}


def report_head(size: int = 96) -> Reconstruction:
    """Evenly lit by 0.8: no warning applies to it."""
    head = small_head(size)
    even = np.full_like(head.photo.image, 0.8)
    render = head.face.maps.diffuse_albedo * even * (head.face.mask > 0)[..., None]
    settings = {"resolution": size, "stage1": {"iterations": 50}}
    return replace(
        head,
        photo_name="grüße <b>&.jpg",
        image=np.maximum(render, 0.05),
        render=render,
        diffuse_shading=even,
        settings=settings,
        metrics=METRICS,
    )
