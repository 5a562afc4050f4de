"""A coloured light, and a pinned gain, from the photo to the result."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tiny_run
from changed import part
from small_head import save_quickly
from unlit.color import luminance
from unlit.conditions.estimate import estimate_conditions
from unlit.errors import SettingsError
from unlit.face.gain import peak_luminance
from unlit.face.photo import FacePhoto
from unlit.face.reconstruction import Reconstruction
from unlit.output.load import load
from unlit.output.save import save
from unlit.photo.photo import Photo
from unlit.pipeline.chain import Steps, reconstruct
from unlit.pipeline.resume import resume
from unlit.render.interreflection import IndirectLight
from unlit.render.relighter import Relighter
from unlit.settings.detail import FineDetail
from unlit.settings.settings import Settings

#: Dividing by powers of two is exact.
COLOR = np.array([1, 0.5, 0.25], np.float32)
REFLECTANCE = (
    "face.maps.diffuse_albedo",
    "face.maps.specular_albedo",
    "face.maps.perturbation",
    "face.mesh.vertices",
)


def estimated(seen: FacePhoto, settings: Settings) -> Steps:
    """Steps for a photo that is its own crop: only its light is not known."""
    known = tiny_run.steps(seen)
    source = Photo.of(np.ones_like(seen.image))  # something white beside the face

    def conditions(photo: Any, head: Any, settings: Settings) -> Any:
        return estimate_conditions(photo, head, source, settings)

    return replace(known, estimate_conditions=conditions)


def relit(result: Reconstruction, light: Any) -> np.ndarray:
    return Relighter(result.face)(light)


@pytest.fixture(scope="module")
def white():
    return tiny_run.run()


@pytest.fixture(scope="module")
def coloured():
    """The same head under a lamp of another colour, which is known."""
    seen = tiny_run.photo()
    seen = replace(seen, image=seen.image * COLOR)
    settings = tiny_run.settings(light_color="4,2,1")
    return tiny_run.run(chosen=settings, known=estimated(seen, settings))


def test_the_lights_colour_leaves_no_trace_in_the_reflectance(white, coloured):
    for name in REFLECTANCE:
        np.testing.assert_array_equal(part(coloured, name), part(white, name), err_msg=name)
    np.testing.assert_array_equal(coloured.light.amplitude, white.light.amplitude)


def test_photo_and_render_keep_it(white, coloured):
    np.testing.assert_array_equal(coloured.light.color, COLOR)
    np.testing.assert_array_equal(coloured.photo.image, white.photo.image * COLOR)
    shown, plain = coloured.images, white.images
    np.testing.assert_allclose(shown.render, plain.render * COLOR, rtol=1e-6)
    np.testing.assert_array_equal(shown.diffuse_shading, plain.diffuse_shading * COLOR)


def test_relit_by_its_own_light_it_is_the_photo_again(white, coloured):
    """And by a white light as if it had never been coloured."""
    own = relit(coloured, coloured.light)
    np.testing.assert_allclose(own, relit(white, white.light) * COLOR, rtol=1e-3, atol=1e-5)
    inside = coloured.face.mask > 0.5
    np.testing.assert_allclose(
        own[inside].mean(0), coloured.images.render[inside].mean(0), rtol=0.02
    )
    uniform = np.ones((180, 360), np.float32)
    np.testing.assert_array_equal(relit(coloured, uniform), relit(white, uniform))


def test_warnings_do_not_depend_on_it(white, coloured):
    assert coloured.metrics.warnings == white.metrics.warnings


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
    model: Any = object()
    seen = tiny_run.photo()
    monkeypatch.setattr("unlit.pipeline.chain.observe", lambda *_, **__: seen)
    monkeypatch.setattr("unlit.pipeline.chain.fit_head", lambda *_: pytest.fail("it was fitted"))
    with pytest.raises(SettingsError, match=message):
        reconstruct(Photo.of(seen.image), settings=tiny_run.settings(**said), model=model)


@pytest.fixture(scope="module")
def pinned():
    """Without highlights, which are looked for again when a run goes on."""
    plain = FineDetail(highlight_most=0.0)
    return tiny_run.run(chosen=replace(tiny_run.settings(exposure="skin=0.2"), detail=plain))


def test_the_skin_gets_the_albedo_that_is_known(pinned):
    skin = (pinned.photo.regions.skin > 0.5) & (pinned.face.mask > 0)
    assert luminance(pinned.face.maps.diffuse_albedo[skin]).mean() == pytest.approx(0.2, rel=1e-4)


def test_a_measured_illuminance_is_that_of_the_result(white):
    """The best-lit skin gets it, the albedo follows, and the picture stays."""
    measured = replace(tiny_run.photo(), white_luminance=1000.0)
    lit = tiny_run.run(chosen=tiny_run.settings(exposure="2400lux"), known=tiny_run.steps(measured))
    inside = white.face.mask > 0
    full = peak_luminance(lit.images.diffuse_shading[inside])
    assert np.pi * 1000 * full == pytest.approx(2400, rel=0.01)
    assert np.log(lit.gain / white.gain) > 0.2
    means = [result.images.render[inside].mean(axis=0) for result in (lit, white)]
    np.testing.assert_allclose(*means, rtol=0.02)


def test_by_convention_a_white_card_would_be_brighter_than_the_photos_white(white):
    """By 1 / 0.7 where the face is lit best, as long as albedo stays within 1."""
    inside = white.face.mask > 0
    assert white.gain == 0.7
    full = np.percentile(white.images.diffuse_shading[inside].mean(axis=1), 99)
    assert full == pytest.approx(1 / 0.7, rel=0.05)


@pytest.mark.parametrize(
    ("said", "color"),
    [("auto", "white"), ("skin=0.2", "white"), ("3000lux", "white"), ("3000lux", "4,2,1")],
)
def test_inter_reflection_takes_the_albedo_of_the_result(monkeypatch, said, color):
    """What the face reflects onto itself is always that of the albedo that is saved."""
    shown = []
    original = IndirectLight.shade

    def watched(self, radiance, maps, gloss=None):
        shown.append(maps.diffuse_albedo)
        return original(self, radiance, maps, gloss)

    monkeypatch.setattr(IndirectLight, "shade", watched)
    seen = replace(tiny_run.photo(), white_luminance=1000.0)
    settings = tiny_run.settings(exposure=said, light_color=color)
    result = tiny_run.run(chosen=settings, known=estimated(seen, settings))
    skin = (seen.regions.skin > 0.5) & (result.face.mask > 0)
    level = float(luminance(result.face.maps.diffuse_albedo[skin]).mean())
    known = [float(luminance(albedo[skin]).mean()) for albedo in shown]
    assert len(known) > 10
    # Only a known albedo is that from the start; the others follow the estimate, and arrive.
    rest = known if said.startswith("skin") else known[-len(known) // 4 :]
    np.testing.assert_allclose(rest, level, rtol=0.05 if said.startswith("skin") else 0.01)


def test_its_own_light_gives_the_pinned_render(pinned):
    own, inside = relit(pinned, pinned.light), pinned.face.mask > 0.5
    np.testing.assert_allclose(own[inside].mean(0), pinned.images.render[inside].mean(0), rtol=0.02)


def test_saved_and_resumed(coloured, pinned, tmp_path):
    """From stage 1 the run is repeated; from stage 5, without iterations, the gain is pinned."""
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(coloured, tmp_path / "a")
        save(pinned, tmp_path / "b")
    a, b = load(tmp_path / "a"), load(tmp_path / "b")
    again = resume(a, 1, tiny_run.settings(light_color="4,2,1"))
    for name in (*REFLECTANCE, "images.render"):
        np.testing.assert_array_equal(part(again, name), part(coloured, name), err_msg=name)
    chosen = pinned.settings
    still = replace(chosen, stage5=replace(chosen.stage5, iterations=0))
    inside = pinned.face.mask > 0
    np.testing.assert_allclose(
        resume(b, 5, still).face.maps.diffuse_albedo[inside],
        pinned.face.maps.diffuse_albedo[inside],
        rtol=1e-3,
    )
    with pytest.raises(SettingsError, match="keeps its own, "):
        resume(a, 4, tiny_run.settings())
