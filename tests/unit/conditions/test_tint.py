"""Light whose colour changes over the face, told by the face's two halves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

import tiny_run
from bumpy_head import bumpy_head
from sun_head import sun_head
from unlit.conditions import estimate as module
from unlit.conditions.halves import Halves, across, mirror_plane
from unlit.conditions.tint import tint
from unlit.face.conditions import Conditions, Shadow
from unlit.optimize.observation import Observation
from unlit.perception.topology import FACE_OVAL
from unlit.photo.photo import Photo
from unlit.scene.camera import Camera
from unlit.settings.settings import PRESETS, override

SIZE = 128
SETTINGS = override(PRESETS["draft"], {"first_stage_iterations": 30})
SIDE = np.array([0.8, 0.2, 0.55]) / np.linalg.norm([0.8, 0.2, 0.55])
RIGHT = np.array([1.0, 0, 0])
SKIN = np.array([0.5, 0.35, 0.28])


def lit_from_the_side(mark: bool = False) -> tuple[Observation, np.ndarray, np.ndarray]:
    """A head under white light from the right, what its pixels are, and its log brightness.

    Freckles are darker, and redder; mark: one cheek has a red one.
    """
    head = sun_head(SIZE)
    problem, rng = head.problem, np.random.default_rng(5)
    freckles = ndimage.gaussian_filter(rng.standard_normal((SIZE, SIZE)), 1.5)
    freckles = 0.08 * freckles / freckles.std()
    albedo = np.exp(freckles[..., None] * (0.8, 1.0, 1.1)) * SKIN
    if mark:
        albedo[red_cheek()] *= (1.0, 0.7, 0.7)
    shading = 0.25 + np.maximum(problem.image_of(head.surface.normal @ SIDE), 0)
    image = np.where(problem.inside[..., None], albedo * shading[..., None], 0.3)
    seen = replace(head.observation, image=image.astype(np.float32))
    return seen, problem.inside, np.log(image).mean(axis=2)


def red_cheek() -> np.ndarray:
    row, column = np.indices((SIZE, SIZE))
    return np.hypot(row - 0.6 * SIZE, column - 0.36 * SIZE) < 0.05 * SIZE


def toned(seen: Observation, brightness: np.ndarray) -> Observation:
    """Redder, and less blue, the darker it is, as a tone curve makes skin."""
    shift = 0.3 * (-1.2 - brightness)[..., None] * (1.0, 0.0, -0.8)
    return replace(seen, image=(seen.image * np.exp(shift)).astype(np.float32))


def colour(image: np.ndarray) -> np.ndarray:
    smooth = ndimage.gaussian_filter(image, (2, 2, 0))
    return np.log(smooth[..., [0, 2]] / smooth[..., [1]])


def test_the_plane_of_symmetry_is_found_for_a_turned_head() -> None:
    """From 8 degrees off it, with a piece of one half missing."""
    vertices, _ = bumpy_head(4)
    vertices = (vertices - vertices.mean(axis=0)) * (0.6, 1, 1)  # no ball, which has more planes
    half = vertices[vertices[:, 0] > 0]
    whole = np.concatenate([half, half * (-1, 1, 1)])
    whole = whole[(whole[:, 0] > 0) | (whole[:, 1] > -7)]
    known, rough = (Rotation.from_euler("y", x, degrees=True) for x in (25, 33))
    place = np.array([3.0, 1, -70])
    found, offset = mirror_plane(known.apply(whole) + place, rough.apply(RIGHT))
    wanted = known.apply(RIGHT)
    assert np.degrees(np.arccos(min(found @ wanted, 1))) < 1
    assert abs(found @ place - offset) < 0.1


def test_landmarks_tell_across_in_the_worlds_frame() -> None:
    """Of a face that is turned to its left and tilted: right is +x, up is +y, near is +z."""
    ring = np.linspace(0, 2 * np.pi, len(FACE_OVAL), endpoint=False)
    turn = Rotation.from_euler("yz", (30, 10), degrees=True)
    oval = np.stack([6 * np.sin(ring), 9 * np.cos(ring), 0 * ring - 60], axis=1)
    pixels = np.zeros((478, 3))
    pixels[list(FACE_OVAL)] = 100 + 10 * turn.apply(oval) * (1, -1, -1)
    np.testing.assert_allclose(across(pixels), turn.apply(RIGHT), atol=1e-6)
    np.testing.assert_array_equal(across(np.zeros((478, 3))), RIGHT)


def test_twins_mirror_each_other() -> None:
    problem = sun_head(SIZE).problem
    halves = Halves.of(problem, RIGHT)
    good = (halves.apart < 0.2) & (np.abs(halves.beside) > 1)
    assert good.mean() > 0.5
    apart = halves.beside[good] + halves.beside[halves.twin[good]]
    assert np.abs(apart).max() < 0.3
    mirrored = halves.normal[halves.twin[good]] * (-1, 1, 1)
    assert np.median((mirrored * halves.normal[good]).sum(axis=1)) > 0.99


def test_colour_that_follows_the_brightness_is_taken_out() -> None:
    """Down to a third of the error, with the freckles' own colour kept."""
    seen, inside, brightness = lit_from_the_side()
    photo = toned(seen, brightness)
    found = tint(photo, RIGHT, SETTINGS)
    assert found is not None and found.shape == seen.image.shape and found.dtype == np.float32
    inner: Any = ndimage.binary_erosion(inside, iterations=6)

    def error(image: np.ndarray) -> float:
        apart = colour(image)[inner] - colour(seen.image)[inner]
        return float((apart - apart.mean(axis=0)).std())

    assert error(photo.image / found) < 0.36 * error(photo.image)
    both = [colour(x) for x in (seen.image, photo.image / found)]
    fine = [x - ndimage.gaussian_filter(x, (6, 6, 0)) for x in both]
    assert np.corrcoef(fine[0][inner].ravel(), fine[1][inner].ravel())[0, 1] > 0.8


def test_the_skins_brightness_stays() -> None:
    seen, inside, brightness = lit_from_the_side()
    photo = toned(seen, brightness)
    found = tint(photo, RIGHT, SETTINGS)
    assert found is not None
    inner: Any = ndimage.binary_erosion(inside, iterations=6)
    luminance = [x[inner] @ (0.2126, 0.7152, 0.0722) for x in (photo.image, photo.image / found)]
    np.testing.assert_allclose(luminance[1], luminance[0], rtol=0.06)


def test_one_colour_of_light_has_no_tint() -> None:
    """Nor does a red mark on one cheek make one, and it stays when there is one."""
    assert tint(lit_from_the_side()[0], RIGHT, SETTINGS) is None
    seen, _, brightness = lit_from_the_side(mark=True)
    assert tint(seen, RIGHT, SETTINGS) is None
    photo = toned(seen, brightness)
    found = tint(photo, RIGHT, SETTINGS)
    assert found is not None
    mark: Any = ndimage.binary_erosion(red_cheek(), iterations=2)
    near, far = (ndimage.binary_dilation(red_cheek(), iterations=n) for n in (2, 5))
    around: Any = np.asarray(far, bool) & ~np.asarray(near, bool)
    both = [colour(x) for x in (seen.image, photo.image / found)]
    contrast = [c[mark].mean(axis=0) - c[around].mean(axis=0) for c in both]
    assert contrast[1][0] > 0.75 * contrast[0][0]


def test_a_larger_crop_has_the_same_tint() -> None:
    """Found at 256 pixels, and brought to the crop's."""
    seen, inside, brightness = lit_from_the_side()
    photo = toned(seen, brightness)
    found, size = tint(photo, RIGHT, SETTINGS), 3 * SIZE
    large = larger(photo, size)
    again = tint(large, RIGHT, SETTINGS)
    assert found is not None and again is not None and again.shape == (size, size, 3)
    inner = np.asarray(ndimage.binary_erosion(inside, iterations=8), bool)
    apart = np.log(again[1::3, 1::3][inner] / found[inner])
    assert apart.std() < 0.25 * np.log(found[inner]).std()


def larger(seen: Observation, size: int) -> Observation:
    def scaled(image: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.resize(image.astype(np.float32), (size, size)))

    camera, scale = seen.camera, size / seen.camera.width
    return replace(
        seen,
        image=scaled(seen.image),
        regions=np.repeat(np.repeat(seen.regions, size // SIZE, axis=0), size // SIZE, axis=1),
        mask=scaled(seen.mask) > 0.5,
        weight=scaled(seen.weight),
        fitted=scaled(seen.fitted) > 0.5,
        camera=Camera(size, size, camera.focal * scale, camera.cx * scale, camera.cy * scale),
    )


def test_it_does_not_depend_on_the_exposure() -> None:
    seen, inside, brightness = lit_from_the_side()
    photo = toned(seen, brightness)
    found = tint(photo, RIGHT, SETTINGS)
    dim = tint(replace(photo, image=photo.image * np.float32(0.6)), RIGHT, SETTINGS)
    assert found is not None and dim is not None
    np.testing.assert_allclose(dim[inside], found[inside], rtol=0.05)


def test_too_few_pairs_tell_nothing() -> None:
    seen, _, brightness = lit_from_the_side()
    photo = toned(seen, brightness)
    one_half = seen.mask & (np.indices((SIZE, SIZE))[1] > 0.55 * SIZE)
    assert tint(replace(photo, mask=one_half), RIGHT, SETTINGS) is None
    assert tint(replace(photo, mask=np.zeros_like(seen.mask)), RIGHT, SETTINGS) is None


def test_shadow_and_tint_are_both_taken_out() -> None:
    rng = np.random.default_rng(1)
    image, remaining, tinted = rng.uniform(0.2, 1, (3, 8, 8, 3)).astype(np.float32)
    ones = np.ones((8, 8), np.float32)
    shadow = Shadow(ones, remaining, ones)
    white = np.array([1, 0.5, 0.25], np.float32)
    for known, wanted in (
        (Conditions(white), image / white),
        (Conditions(white, tint=tinted), image / tinted / white),
        (Conditions(white, shadow=shadow, tint=tinted), image / (remaining * tinted) / white),
    ):
        np.testing.assert_allclose(known.balanced(image), wanted, rtol=1e-6)


@pytest.mark.parametrize("mode", ["auto", "never"])
def test_it_is_looked_for_unless_it_is_forbidden(
    monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    seen = tiny_run.photo()
    made = np.full((*seen.image.shape[:2], 3), 1.1, np.float32)
    monkeypatch.setattr(module, "tint", lambda *_: made)
    settings = tiny_run.settings(**{"tint.mode": mode})
    source = Photo.of(np.ones((60, 90, 3), np.float32))
    found = module.estimate_conditions(seen, tiny_run.head(), source, settings).tint
    assert (found is made) == (mode == "auto")


def test_the_result_has_the_tint_again() -> None:
    """Albedo and light are those of the even photo; shading and render have the photo's colours."""
    seen = tiny_run.photo()
    ramp = np.linspace(0.8, 1.25, seen.image.shape[1], dtype=np.float32)
    made = np.broadcast_to(np.stack([ramp, np.ones_like(ramp), 1 / ramp], 1), seen.image.shape)
    plain = tiny_run.run(known=tiny_run.steps(seen))
    tinted = tiny_run.run(
        known=tiny_run.steps(
            replace(seen, image=seen.image * made), conditions=Conditions(tint=made)
        )
    )
    for one, other in zip(
        (tinted.face.maps.diffuse_albedo, tinted.light.amplitude),
        (plain.face.maps.diffuse_albedo, plain.light.amplitude),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(
        tinted.images.render, plain.images.render * made, rtol=1e-4, atol=1e-6
    )
