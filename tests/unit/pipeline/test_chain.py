"""The one chain: what its steps get, what may be replaced, and what is kept of the run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from unlit.errors import FaceError
from unlit.face.conditions import Conditions
from unlit.face.head import FittedHead
from unlit.face.photo import FacePhoto
from unlit.optimize.run_record import RunRecord
from unlit.pipeline.chain import Steps, run_chain
from unlit.settings.settings import TABLE_1, Settings


def test_each_step_gets_what_those_before_it_found() -> None:
    """In order, each told of; their parts are the result's own, and every step has its time."""
    seen, head, conditions, chosen = (
        tiny_run.photo(),
        tiny_run.head(),
        Conditions(),
        tiny_run.settings(),
    )
    asked: list[tuple[object, ...]] = []

    def observe(*given: object) -> FacePhoto:
        asked.append(given)
        return seen

    def fit(*given: object) -> FittedHead:
        asked.append(given)
        return head

    def estimate(*given: object) -> Conditions:
        asked.append(given)
        return conditions

    told: list[str] = []
    run = RunRecord(lambda stage, *_: told.append(stage))
    result = run_chain(Steps(observe, fit, estimate), chosen, run)
    assert [len(given) for given in asked] == [1, 2, 3]
    for given, wanted in zip(asked, ((chosen,), (seen, chosen), (seen, head, chosen)), strict=True):
        assert all(a is b for a, b in zip(given, wanted, strict=True))
    assert result.photo is seen
    assert result.head is head
    assert result.conditions is conditions
    assert result.settings is chosen
    assert list(dict.fromkeys(told)) == ["perception", "fit", "conditions", *TABLE_1, "finish"]
    assert list(result.metrics.seconds) == ["perception", "fit", "conditions", *TABLE_1]
    assert list(result.metrics.losses) == list(TABLE_1)
    assert result.metrics.peak_memory_mb > 10
    told.clear()
    run = RunRecord(lambda stage, *_: told.append(stage))
    again = run_chain(Steps(observe, fit, estimate, kept=True), chosen, run)
    assert list(dict.fromkeys(told)) == [*TABLE_1, "finish"]
    assert list(again.metrics.seconds) == list(TABLE_1)


def test_the_true_mesh_in_the_place_of_a_fit() -> None:
    """Without landmarks; without stage 3 it is the result's mesh to the bit."""
    mesh = tiny_run.head().mesh

    def true_head(seen: FacePhoto, _: Settings) -> FittedHead:
        return FittedHead.of_mesh(mesh.vertices, mesh.triangles, seen.landmarks)

    chosen = tiny_run.settings()
    still = replace(chosen, stage3=replace(chosen.stage3, iterations=0))
    result = tiny_run.run(chosen=still, known=replace(tiny_run.steps(), fit_head=true_head))
    np.testing.assert_allclose(result.face.mesh.vertices, mesh.vertices, atol=1e-4)
    np.testing.assert_array_equal(result.head.mesh.vertices, mesh.vertices)
    assert (result.head.landmark_points.triangle == -1).all()
    assert result.head.landmark_residual is None
    moved = tiny_run.run(known=replace(tiny_run.steps(), fit_head=true_head))
    assert np.isfinite(moved.face.mesh.vertices).all()


def test_a_head_beside_the_face_is_an_error_that_names_the_photo() -> None:
    head = tiny_run.head()
    away = replace(head, mesh=replace(head.mesh, vertices=head.mesh.vertices + np.float32(60)))
    with pytest.raises(FaceError, match=r"^tiny\.png: .*do not overlap; use a photo"):
        tiny_run.run(known=tiny_run.steps(fitted=away))
