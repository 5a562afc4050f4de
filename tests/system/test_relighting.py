"""Quality on subjects with known truth: shapes that the default head model has never seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import unlit
from unlit.evaluate.metrics import best_gain, psnr


@pytest.mark.parametrize(
    ("skin", "true_mesh", "bar"), [("light", True, 31.0), ("dark", False, 24.0)]
)
def test_flash_to_uniform(shared: Path, skin: str, true_mesh: bool, bar: float) -> None:
    """From a flash photo, relit under uniform light (draft preset), in dB inside the face.

    The bars are below what the whole schedule reaches (docs/lab/method-notes-results.md), for the
    preset is short.
    """
    from ict import ict_subject
    from unlit.face.head import FittedHead
    from unlit.face.photo import FacePhoto
    from unlit.head.sources.library import default_model
    from unlit.optimize.run_record import RunRecord
    from unlit.pipeline.chain import fitting, run_chain, steps_of
    from unlit.render.relighter import Relighter

    subject = ict_subject(shared, skin, seed=1, size=256)
    flash, uniform = (
        subject.photograph(light, samples=64)
        for light in (unlit.lights.flash(), unlit.lights.uniform())
    )
    photo = unlit.Photo.of(flash * (0.8 / np.percentile(flash[subject.mask], 99)))
    settings = unlit.override(unlit.PRESETS["draft"], {"cast_shadow.mode": "keep"})

    def true_head(seen: FacePhoto, _: unlit.Settings) -> FittedHead:
        return FittedHead.of_mesh(subject.vertices, subject.triangles, seen.landmarks)

    fit = true_head if true_mesh else fitting(default_model())
    steps = steps_of(photo, fit, camera=subject.camera)
    result = run_chain(steps, settings, RunRecord(lambda *_: None))
    relit = Relighter(result.face)(unlit.lights.uniform())
    inside = subject.mask & (result.face.mask > 0.5) & (result.photo.regions.eyes < 0.3)
    gain = best_gain(relit, uniform, inside)
    assert psnr(relit * gain, uniform, inside) > bar
