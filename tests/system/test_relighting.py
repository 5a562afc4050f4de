"""Quality on subjects with known truth: shapes that the default head model has never seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import unlit
from unlit.evaluate.metrics import best_gain
from unlit.evaluate.psnr import psnr


@pytest.mark.parametrize(
    ("skin", "true_mesh", "bar"), [("light", True, 31.0), ("dark", False, 24.0)]
)
def test_flash_to_uniform(shared: Path, skin: str, true_mesh: bool, bar: float) -> None:
    """From a flash photo, relit under uniform light (draft preset), in dB inside the face.

    The bars are below what the whole schedule reaches (docs/method.md), for the preset is short.
    """
    from ict import ict_subject
    from unlit.head.sources.library import default_model
    from unlit.pipeline.chain import Head, fitted_head, observe, solve

    subject = ict_subject(shared, skin, seed=1, size=256)
    flash, uniform = (
        subject.photograph(light, samples=64)
        for light in (unlit.lights.flash(), unlit.lights.uniform())
    )
    photo = unlit.Photo.of(flash * (0.8 / np.percentile(flash[subject.mask], 99)))
    settings = unlit.PRESETS["draft"]
    capture = observe(photo, 256, camera=subject.camera)
    if true_mesh:
        head = Head.of_mesh(subject.vertices, subject.triangles)
    else:
        head = fitted_head(capture, default_model(), settings)
    face = solve(capture, head, settings)
    relit = face.relight(unlit.lights.uniform())
    inside = subject.mask & (face.mask > 0.5) & (capture.regions.eyes < 0.3)
    gain = best_gain(relit, uniform, inside)
    assert psnr(relit * gain, uniform, inside) > bar
