"""The small head with what a report shows besides maps: a photo, shading, metrics, settings."""

from __future__ import annotations

import numpy as np

from changed import changed
from small_head import small_head
from unlit.face.reconstruction import Metrics, Reconstruction

METRICS = Metrics(
    losses={"stage1": [(0, 0.5), (25, 0.05), (50, 0.02)], "stage2": [(0, 0.1), (10, 0.1)]},
    seconds={"photo": 0.5, "stage1": 12.25},
    peak_memory_mb=700.0,
)


def report_head(size: int = 96) -> Reconstruction:
    """Evenly lit by 0.8: no warning applies to it."""
    head = small_head(size)
    even = np.full_like(head.photo.image, 0.8)
    render = head.face.maps.diffuse_albedo * even * (head.face.mask > 0)[..., None]
    return changed(
        head,
        {
            "photo.name": "grüße <b>&.jpg",
            "photo.image": np.maximum(render, 0.05),
            "head.landmark_residual": 0.02,
            "images.render": render,
            "images.diffuse_shading": even,
            "settings.stage1.iterations": 50,
            "metrics": METRICS,
        },
    )
