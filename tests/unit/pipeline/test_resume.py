"""Some stages again on a saved result: they start from what is there, edited or not."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import tiny_run
from small_head import save_quickly
from unlit.errors import OutputError, SettingsError
from unlit.output import edited, load, save
from unlit.pipeline.chain import solve
from unlit.pipeline.resume import continued


@pytest.fixture(scope="module")
def face():
    return tiny_run.run()


def still(*stages: int):
    """Settings without any iteration in these stages."""
    chosen = tiny_run.settings()
    names = [f"stage{k}" for k in stages]
    return replace(chosen, **{n: replace(getattr(chosen, n), iterations=0) for n in names})


def test_from_stage_1_repeats_the_run(face, tmp_path):
    """Saved and loaded, all that the stages saw of the photo is there again, to the bit."""
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(face, tmp_path / "a")
    again = continued(load(tmp_path / "a"), 1, tiny_run.settings())
    for name in ("diffuse_albedo", "specular_albedo", "perturbation", "vertices", "render", "mask"):
        np.testing.assert_array_equal(getattr(again, name), getattr(face, name), err_msg=name)
    np.testing.assert_array_equal(again.light.amplitude, face.light.amplitude)
    assert again.metrics["losses"] == face.metrics["losses"]
    assert again.metrics["continued_from_stage"] == 1


def test_a_cast_shadow_is_no_evidence(face):
    """What is dark there leaves no trace; continued, it is left out again."""
    seen = tiny_run.capture()
    lit = np.ones(seen.image.shape[:2], np.float32)
    lit[:14] = 0
    image = seen.image.copy()
    image[:14] *= 0.3
    dark = replace(seen, image=image, lit=lit)
    result = solve(dark, tiny_run.head(), tiny_run.settings())
    other = solve(replace(seen, lit=lit), tiny_run.head(), still())
    np.testing.assert_array_equal(result.lit, lit)
    assert result.mask[:14].max() == 1
    np.testing.assert_array_equal(result.diffuse_albedo, other.diffuse_albedo)
    np.testing.assert_array_equal(result.light.amplitude, other.light.amplitude)
    again = continued(result, 1, tiny_run.settings())
    np.testing.assert_array_equal(again.diffuse_albedo, result.diffuse_albedo)


def test_a_painted_albedo_is_the_start(face, tmp_path):
    """Without an iteration it comes back as painted: the gain is undone and given again."""
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(face, tmp_path / "a")
    path = tmp_path / "a" / "diffuse_albedo.png"
    pixels = np.array(Image.open(path))
    pixels[10:16, 10:20] = (180, 120, 90)
    Image.fromarray(pixels).save(path)
    start, files = edited(load(tmp_path / "a"), tmp_path / "a", 5)
    assert files == ["diffuse_albedo.png"]
    result = continued(start, 5, still(5))
    inside = result.mask > 0
    gain = (result.diffuse_albedo / start.face.maps.diffuse_albedo)[inside]
    np.testing.assert_allclose(gain, gain.mean(), rtol=1e-4)
    assert gain.mean() == pytest.approx(1, rel=0.05)
    np.testing.assert_allclose(
        result.specular_albedo[inside], face.specular_albedo[inside], rtol=0.2
    )
    np.testing.assert_allclose(result.vertices, face.vertices, atol=1e-5)
    np.testing.assert_allclose(result.perturbation, face.perturbation, atol=1e-6)
    assert set(result.metrics["losses"]) == {"stage1", "stage2", "stage3", "stage4"}


@pytest.mark.parametrize("stage", [2, 3, 4])
def test_every_stage_can_be_the_first(face, stage):
    """The earlier ones' losses are kept, the later ones run on the smaller mask."""
    regions = face.regions.copy()
    regions[:12] = (0, 0, 0, 0, 0, 1)
    result = continued(replace(face, regions=regions), stage, tiny_run.settings())
    assert list(result.metrics["losses"]) == [f"stage{k}" for k in range(1, 6)]
    assert result.metrics["losses"]["stage1"] == face.metrics["losses"]["stage1"]
    assert result.mask[:12].max() == 0
    assert result.mask[12:].max() == 1
    inside = result.mask > 0
    assert np.abs(result.render - result.image)[inside].mean() < 0.15
    np.testing.assert_array_equal(result.fit.vertices, face.fit.vertices)


def test_what_cannot_be_continued(face):
    """Results without the fit, other sizes, stages there are not."""
    with pytest.raises(OutputError, match="saved by an older unlit"):
        continued(replace(face, fit=None), 2, tiny_run.settings())
    with pytest.raises(SettingsError, match="resolution=64"):
        continued(face, 2, replace(tiny_run.settings(), resolution=64))
    with pytest.raises(SettingsError, match=r"landmark_fit\.huber=5\.0: the saved"):
        continued(face, 2, tiny_run.settings(**{"landmark_fit.huber": 5}))
    with pytest.raises(SettingsError, match="head_model=ict: the saved result keeps its own"):
        continued(face, 2, tiny_run.settings(head_model="ict"))
    with pytest.raises(SettingsError, match="choose 1 to 5"):
        continued(face, 6, tiny_run.settings())
