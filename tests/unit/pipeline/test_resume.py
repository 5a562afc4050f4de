"""Some stages again on a saved result: they start from what is there, edited or not."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import tiny_run
from changed import changed, part
from small_head import save_quickly
from unlit.errors import SettingsError
from unlit.face.conditions import Conditions, Shadow
from unlit.output.edits import edited
from unlit.output.load import load
from unlit.output.save import save
from unlit.pipeline.resume import check_resumable, resume
from unlit.settings.detail import FineDetail

#: The last stage is the end.
PLAIN = FineDetail(relief=1.0, most=0.0, highlight_most=0.0)


@pytest.fixture(scope="module")
def face():
    return tiny_run.run()


def still(*stages: int):
    """Settings without any iteration in these stages, or what follows the last."""
    chosen = replace(tiny_run.settings(), detail=PLAIN)
    names = [f"stage{k}" for k in stages]
    return replace(chosen, **{n: replace(getattr(chosen, n), iterations=0) for n in names})


def test_from_stage_1_repeats_the_run(face, tmp_path):
    """Saved and loaded, all that the stages saw of the photo is there again, to the bit."""
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(face, tmp_path / "a")
    again = resume(load(tmp_path / "a"), 1, tiny_run.settings())
    maps = [f"face.maps.{name}" for name in ("diffuse_albedo", "specular_albedo", "perturbation")]
    for name in (*maps, "face.mesh.vertices", "images.render", "face.mask"):
        np.testing.assert_array_equal(part(again, name), part(face, name), err_msg=name)
    np.testing.assert_array_equal(again.light.amplitude, face.light.amplitude)
    assert again.metrics.losses == face.metrics.losses
    assert again.metrics.continued_from_stage == 1


def test_a_shadow_is_taken_out_and_put_back(face):
    """The maps are as without it, what counts less aside; the render has it; so continued."""
    seen = tiny_run.photo()
    remaining = np.ones_like(seen.image)
    remaining[:14] = 0.5
    visibility = np.ones(seen.image.shape[:2], np.float32)
    conditions = Conditions(shadow=Shadow(visibility, remaining, visibility))
    dark = replace(seen, image=seen.image * remaining)
    result = tiny_run.run(known=tiny_run.steps(dark, conditions=conditions))
    albedo = result.face.maps.diffuse_albedo
    lit = face.face.mask > 0
    change = np.abs(np.log(albedo / face.face.maps.diffuse_albedo))[lit]
    assert np.median(change) < 0.03
    shaded = lit & (remaining[..., 0] < 1)
    levels = [np.median(r.images.render[shaded]) for r in (result, face)]
    np.testing.assert_allclose(levels[0] / levels[1], 0.5, rtol=0.05)
    again = resume(result, 1, tiny_run.settings())
    np.testing.assert_array_equal(again.face.maps.diffuse_albedo, albedo)


def test_a_painted_albedo_is_the_start(face, tmp_path):
    """Without an iteration it comes back as painted: the gain is undone and given again."""
    face = changed(face, {"settings.detail": PLAIN})
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(face, tmp_path / "a")
    path = tmp_path / "a" / "diffuse_albedo.png"
    pixels = np.array(Image.open(path))
    pixels[10:16, 10:20] = (180, 120, 90)
    Image.fromarray(pixels).save(path)
    start, files = edited(load(tmp_path / "a"), tmp_path / "a", 5)
    assert files == ["diffuse_albedo.png"]
    result = resume(start, 5, still(5))
    inside = result.face.mask > 0
    gain = (result.face.maps.diffuse_albedo / start.face.maps.diffuse_albedo)[inside]
    np.testing.assert_allclose(gain, gain.mean(), rtol=1e-4)
    assert gain.mean() == pytest.approx(1, rel=0.05)
    np.testing.assert_allclose(
        result.face.maps.specular_albedo[inside],
        face.face.maps.specular_albedo[inside],
        rtol=0.2,
    )
    np.testing.assert_allclose(result.face.mesh.vertices, face.face.mesh.vertices, atol=1e-5)
    perturbation = face.face.maps.perturbation
    np.testing.assert_allclose(result.face.maps.perturbation, perturbation, atol=1e-6)
    assert set(result.metrics.losses) == {"stage1", "stage2", "stage3", "stage4"}


@pytest.mark.parametrize("solver", ["adam", "primal-dual"])
def test_painted_gloss_is_the_start(face, solver):
    """Stage 2 begins with the map as it is, not with one level, as it does after stage 1."""
    gloss = face.face.maps.specular_albedo.copy()
    gloss[:, : tiny_run.SIZE // 2] *= 0.5
    painted = changed(face, {"face.maps.specular_albedo": gloss})
    result = resume(painted, 2, replace(still(2, 3, 4, 5), solver=solver))
    inside = result.face.mask > 0
    ratio = (result.face.maps.specular_albedo / gloss)[inside]
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-4)


@pytest.mark.parametrize("stage", [2, 3, 4])
def test_every_stage_can_be_the_first(face, stage):
    """The earlier ones' losses are kept, the later ones run on the smaller mask."""
    regions = face.photo.regions.weights.copy()
    regions[:12] = (0, 0, 0, 0, 0, 1)
    masked = changed(face, {"photo.regions.weights": regions})
    result = resume(masked, stage, tiny_run.settings())
    assert list(result.metrics.losses) == [f"stage{k}" for k in range(1, 6)]
    assert result.metrics.losses["stage1"] == face.metrics.losses["stage1"]
    assert result.face.mask[:12].max() == 0
    assert result.face.mask[12:].max() == 1
    inside = result.face.mask > 0
    assert np.abs(result.images.render - result.photo.image)[inside].mean() < 0.15
    np.testing.assert_array_equal(result.head.mesh.vertices, face.head.mesh.vertices)


def test_what_cannot_be_resume(face):
    """Other settings of what is kept, stages there are not."""
    with pytest.raises(SettingsError, match="resolution=300"):
        resume(face, 2, tiny_run.settings(resolution=300))
    for changes in (
        {"light_color": "2700K"},
        {"cast_shadow.mode": "auto"},
        {"landmark_fit.huber": 5},
    ):
        with pytest.raises(SettingsError, match="the saved result keeps its own"):
            check_resumable(face, 2, tiny_run.settings(**changes))
    with pytest.raises(SettingsError, match="head_model=ict: the saved result keeps its own"):
        resume(face, 2, tiny_run.settings(head_model="ict"))
    with pytest.raises(SettingsError, match="choose 1 to 5"):
        resume(face, 6, tiny_run.settings())
