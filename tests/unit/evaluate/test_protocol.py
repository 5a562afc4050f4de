"""The protocol on a small head that no network has to find: its steps, its cache, its ablation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from painting import Subject

from bumpy_head import bumpy_head, camera, painted, view
from changed import changed
from unlit.errors import SubjectError
from unlit.evaluate import protocol
from unlit.evaluate.figure import check_sheet, result_sheet, sheet
from unlit.evaluate.persons import consistency
from unlit.evaluate.protocol import NamedLight, Study
from unlit.evaluate.step_cache import StepCache
from unlit.face.photo import FacePhoto
from unlit.perception.regions import Regions
from unlit.photo.crop import Crop
from unlit.photo.photo import Photo
from unlit.pipeline.chain import FitHead, Steps, steps_of
from unlit.scene.camera import Camera
from unlit.scene.light import disc, flash, uniform
from unlit.settings.settings import PRESETS, Settings

SIZE = 48


def short(iterations: int) -> Settings:
    stages = {f"stage{k}": getattr(PRESETS["draft"], f"stage{k}") for k in range(1, 6)}
    few = {name: replace(stage, iterations=iterations) for name, stage in stages.items()}
    return replace(PRESETS["draft"], light_points=500, bounces=1, **few)


@pytest.fixture(scope="module")
def subject() -> Subject:
    vertices, triangles = bumpy_head(3)
    maps = painted(SIZE)
    seen = view(vertices, triangles, camera(SIZE), maps).inside(2)
    return Subject("bumpy", vertices, triangles, camera(SIZE), maps, seen)


@pytest.fixture
def study(subject: Subject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Study:
    """Everything inside the subject's mask is skin, and the subject's own mesh is given."""

    def steps(photo: Photo, fit: FitHead, face: str, camera: Camera) -> Steps:
        weights = np.zeros((SIZE, SIZE, 6), np.float32)
        weights[..., 0], weights[..., 5] = subject.mask, ~subject.mask
        crop = Crop(np.eye(2, 3), SIZE)
        landmarks = np.zeros((478, 3))
        landmarks[[10, 152, 2], 1] = 5, 43, 30  # upright
        seen = FacePhoto(photo.source, photo.pixels, camera, crop, Regions(weights), landmarks)
        return replace(steps_of(photo, fit, face, camera=camera), observe=lambda _: seen)

    monkeypatch.setattr(protocol, "steps_of", steps)
    monkeypatch.setattr(protocol, "compare", lambda *_: {"gain": 1.0, "psnr": 20.0})
    lights = (NamedLight("flash", flash()), NamedLight("uniform", uniform()))
    store = StepCache(tmp_path / "steps")
    return Study(subject, "bumpy", lights, short(30), store, samples=16, true_mesh=True)


def test_a_camera_that_sees_nothing(study: Study, subject: Subject) -> None:
    """One line with the likely causes, before anything is rendered."""
    nothing = replace(subject, mask=np.zeros_like(subject.mask))
    with pytest.raises(SubjectError, match=r"sees nothing of it.*camera_to_world.*units"):
        replace(study, subject=nothing).shots()


def test_shots_are_exposed(study: Study, subject: Subject) -> None:
    """The brightest skin is at 0.8, and the light is scaled like the picture."""
    for shot, light in zip(study.shots(), study.lights, strict=True):
        brightest = np.percentile(shot.image[subject.mask].max(axis=-1), 99)
        assert brightest == pytest.approx(0.8, rel=1e-4)
        again = subject.photograph(shot.light.environment, 64, 5)
        assert again[subject.mask].mean() == pytest.approx(
            shot.image[subject.mask].mean(), rel=0.01
        )
        assert shot.light.name == light.name


def test_rows_and_cache(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row per input, a cell per light, maps near the truth; nothing is done a second time."""
    shots = study.shots()
    rows = list(study.rows(shots))
    assert [row.light for row in rows] == ["flash", "uniform"]
    assert [cell.light for cell in rows[0].relit] == ["flash", "uniform"]
    maps = rows[1].maps
    assert maps["albedo_psnr"] > 25
    assert maps["albedo_psnr"] > maps["albedo_psnr_raw"] - 1e-6
    assert maps["mesh_mm"]["mean"] < 0.5
    assert 0 < maps["mesh_normal_degrees"] < 6
    assert sheet([[("a", np.zeros((4, 4), np.uint8))]]).shape[2] == 3
    assert result_sheet(study.subject, rows).shape > check_sheet(study.subject, shots).shape

    def never(*_: object, **__: object) -> None:
        raise AssertionError("a finished step was repeated")

    monkeypatch.setattr(protocol, "run_chain", never)
    monkeypatch.setattr(protocol, "path_traced", never)
    monkeypatch.setattr(protocol, "compare", never)
    monkeypatch.setattr(Subject, "photograph", never)
    again = list(study.rows(study.shots()))
    assert np.array_equal(again[0].relit[1].image, rows[0].relit[1].image)
    assert np.array_equal(
        again[0].face.face.maps.diffuse_albedo, rows[0].face.face.maps.diffuse_albedo
    )
    assert again[0].maps == rows[0].maps
    with pytest.raises(AssertionError, match="repeated"):
        list(replace(study, settings=short(31)).rows(study.shots()))


@pytest.mark.parametrize("stage", [1, 2, 3, 4, 5])
def test_each_stage_can_be_switched_off(study: Study, stage: int) -> None:
    """The others still run and the result is whole (paper, Table 3)."""
    study = replace(study, settings=short(3))
    (row,) = study.rows(study.shots(), ("uniform",), stage)
    assert row.variant == f"without stage {stage}"
    losses = row.face.metrics.losses
    assert sorted(losses) == [f"stage{k}" for k in range(1, 6) if k != stage]
    for image in (
        row.face.face.maps.diffuse_albedo,
        row.face.face.maps.specular_albedo,
        row.face.images.render,
    ):
        assert np.isfinite(image).all()
    assert row.face.face.maps.diffuse_albedo[study.subject.truth.seen].min() > 0
    if stage == 3:
        assert row.face.face.mesh.vertices == pytest.approx(study.subject.mesh()[0], abs=1e-4)


def test_consistency(study: Study) -> None:
    """Albedos under two lights are more alike than the photos; the same photo is the same."""
    lights = (NamedLight("uniform", uniform()), NamedLight("side", disc((0.7, 0.1, 0.7))))
    study = replace(study, lights=lights)
    faces = [row.face for row in study.rows(study.shots())]
    found = consistency(faces)
    assert found["points"] > 300
    assert found["albedo_psnr"] > found["photo_psnr"] + 3
    same = consistency([faces[0], faces[0]])
    assert same["albedo_psnr"] == same["photo_psnr"] == pytest.approx(120, abs=1)
    louder = changed(
        faces[0], {"photo.image": faces[0].photo.image * np.array([0.5, 0.6, 0.7], np.float32)}
    )
    assert consistency([faces[0], louder])["photo_psnr"] > 100
