"""A coloured light, and a pinned gain, from the photo to the result."""

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from small_head import save_quickly
from unlit.color import luminance
from unlit.errors import SettingsError
from unlit.face.gain import full_light
from unlit.face.warnings import findings
from unlit.output import load, save
from unlit.photo.photo import Photo
from unlit.pipeline.chain import reconstruct, solve, with_light_color
from unlit.pipeline.resume import continued
from unlit.render.bounce import BounceUnder

#: Dividing by powers of two is exact.
COLOR = np.array([1, 0.5, 0.25], np.float32)
REFLECTANCE = ("diffuse_albedo", "specular_albedo", "perturbation", "vertices")


@pytest.fixture(scope="module")
def white():
    return tiny_run.run()


@pytest.fixture(scope="module")
def coloured():
    """The same head under a lamp of another colour, which is known."""
    seen = tiny_run.capture()
    seen = replace(seen, image=seen.image * COLOR)
    settings = tiny_run.settings(light_color="4,2,1")
    seen = with_light_color(seen, tiny_run.head(), Photo.of(seen.image), settings)
    return solve(seen, tiny_run.head(), settings)


def test_the_lights_colour_leaves_no_trace_in_the_reflectance(white, coloured):
    for name in REFLECTANCE:
        np.testing.assert_array_equal(getattr(coloured, name), getattr(white, name), err_msg=name)
    np.testing.assert_array_equal(coloured.light.amplitude, white.light.amplitude)


def test_photo_and_render_keep_it(white, coloured):
    np.testing.assert_array_equal(coloured.light.color, COLOR)
    np.testing.assert_array_equal(coloured.image, white.image * COLOR)
    np.testing.assert_allclose(coloured.render, white.render * COLOR, rtol=1e-6)
    np.testing.assert_array_equal(coloured.diffuse_shading, white.diffuse_shading * COLOR)


def test_relit_by_its_own_light_it_is_the_photo_again(white, coloured):
    """And by a white light as if it had never been coloured."""
    own = coloured.relight(coloured.light)
    np.testing.assert_allclose(own, white.relight(white.light) * COLOR, rtol=1e-3, atol=1e-5)
    inside = coloured.mask > 0.5
    np.testing.assert_allclose(own[inside].mean(0), coloured.render[inside].mean(0), rtol=0.02)
    uniform = np.ones((180, 360), np.float32)
    np.testing.assert_array_equal(coloured.relight(uniform), white.relight(uniform))


def test_warnings_do_not_depend_on_it(white, coloured):
    assert findings(coloured) == findings(white)


def test_an_image_as_if_white_stays_the_image_itself():
    """Not even a copy: a result under white light cannot differ from one without the option."""
    seen = tiny_run.capture()
    same = with_light_color(seen, tiny_run.head(), Photo.of(seen.image), tiny_run.settings())
    assert same.balanced is seen.image


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"light_color": "900,5"}, "900,5: outside the photo, which has 32 x 32 pixels"),
        ({"exposure": "900,5=0.4"}, "900,5 is outside the photo or not on"),
        ({"exposure": "1,1=0.4"}, "1,1 is outside the photo or not on"),
        ({"exposure": "500lux"}, "does not tell its exposure time"),
    ],
)
def test_what_the_photo_cannot_tell_is_refused_before_the_fit(monkeypatch, said, message):
    """Pixels outside the picture or beside the face, and lux without EXIF."""
    seen = tiny_run.capture()
    monkeypatch.setattr("unlit.pipeline.chain.observe", lambda *_, **__: seen)
    monkeypatch.setattr("unlit.pipeline.chain.fitted_head", lambda *_: pytest.fail("it was fitted"))
    with pytest.raises(SettingsError, match=message):
        reconstruct(Photo.of(seen.image), settings=tiny_run.settings(**said))


@pytest.fixture(scope="module")
def pinned():
    return tiny_run.run(chosen=tiny_run.settings(exposure="skin=0.2"))


def test_the_skin_gets_the_albedo_that_is_known(pinned):
    skin = (pinned.regions[..., 0] > 0.5) & (pinned.mask > 0)
    assert luminance(pinned.diffuse_albedo[skin]).mean() == pytest.approx(0.2, rel=1e-4)


def test_a_measured_illuminance_is_that_of_the_result(white):
    """The best-lit skin gets it, the albedo follows, and the picture stays."""
    measured = replace(tiny_run.capture(), unit=1000.0)
    lit = solve(measured, tiny_run.head(), tiny_run.settings(exposure="2400lux"))
    inside = white.mask > 0
    full = full_light(lit.diffuse_shading[inside])
    assert np.pi * 1000 * full == pytest.approx(2400, rel=0.01)
    assert np.log(lit.gain / white.gain) > 0.2
    means = [result.render[inside].mean(axis=0) for result in (lit, white)]
    np.testing.assert_allclose(*means, rtol=0.02)


def test_by_convention_a_white_card_would_be_brighter_than_the_photos_white(white):
    """By 1 / 0.7 where the face is lit best, as long as albedo stays within 1."""
    inside = white.mask > 0
    assert white.gain == 0.7
    full = np.percentile(white.diffuse_shading[inside].mean(axis=1), 99)
    assert full == pytest.approx(1 / 0.7, rel=0.05)


@pytest.mark.parametrize(
    ("said", "color"),
    [("auto", "white"), ("skin=0.2", "white"), ("3000lux", "white"), ("3000lux", "4,2,1")],
)
def test_inter_reflection_takes_the_albedo_of_the_result(monkeypatch, said, color):
    """What the face reflects onto itself is always that of the albedo that is saved."""
    shown = []
    original = BounceUnder.shade

    def watched(self, radiance, maps, gloss=None):
        shown.append(maps.diffuse_albedo)
        return original(self, radiance, maps, gloss)

    monkeypatch.setattr(BounceUnder, "shade", watched)
    seen = replace(tiny_run.capture(), unit=1000.0)
    settings = tiny_run.settings(exposure=said, light_color=color)
    seen = with_light_color(seen, tiny_run.head(), Photo.of(seen.image), settings)
    result = solve(seen, tiny_run.head(), settings)
    skin = (seen.regions.skin > 0.5) & (result.mask > 0)
    level = float(luminance(result.diffuse_albedo[skin]).mean())
    known = [float(luminance(albedo[skin]).mean()) for albedo in shown]
    assert len(known) > 10
    # Only a known albedo is that from the start; the others follow the estimate.
    rest = known if said.startswith("skin") else known[len(known) // 2 :]
    np.testing.assert_allclose(rest, level, rtol=0.05)


def test_its_own_light_gives_the_pinned_render(pinned):
    own, inside = pinned.relight(pinned.light), pinned.mask > 0.5
    np.testing.assert_allclose(own[inside].mean(0), pinned.render[inside].mean(0), rtol=0.02)


def test_saved_and_continued(coloured, pinned, tmp_path):
    """From stage 1 the run is repeated; from stage 5, without iterations, the gain is pinned."""
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(coloured, tmp_path / "a")
        save(pinned, tmp_path / "b")
    a, b = load(tmp_path / "a"), load(tmp_path / "b")
    again = continued(a, 1, tiny_run.settings(light_color="4,2,1"))
    for name in (*REFLECTANCE, "render"):
        np.testing.assert_array_equal(getattr(again, name), getattr(coloured, name), err_msg=name)
    chosen = tiny_run.settings(exposure="skin=0.2")
    still = replace(chosen, stage5=replace(chosen.stage5, iterations=0))
    inside = pinned.mask > 0
    np.testing.assert_allclose(
        continued(b, 5, still).diffuse_albedo[inside], pinned.diffuse_albedo[inside], rtol=1e-3
    )
    with pytest.raises(SettingsError, match="keeps its own, "):
        continued(a, 4, tiny_run.settings())
