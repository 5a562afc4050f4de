"""The sun's direction and colours, whether there is one, and its shadow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiny_run
from sun_head import ABOVE, SKY, SUN, SunHead, sun_head
from unlit.conditions import estimate as module
from unlit.conditions.binary_field import mean_field
from unlit.conditions.estimate import estimate_conditions
from unlit.conditions.sun_model import SkinSample, huber
from unlit.conditions.sun_search import SunFit, as_sky, find_sun
from unlit.conditions.sun_shadow import sun_shadow
from unlit.face.conditions import Conditions, Shadow
from unlit.optimize.observation import observation
from unlit.photo.photo import Photo
from unlit.settings.sun import SunSearch, SunShadow

SIZE = 128


@pytest.fixture(scope="module")
def head() -> SunHead:
    return sun_head(SIZE)


@pytest.fixture(scope="module")
def found(head: SunHead) -> SunFit:
    fit = find_sun(head.problem, head.surface, SunSearch())
    assert fit is not None
    return fit


def degrees(fit: SunFit) -> float:
    return float(np.degrees(np.arccos(np.clip(fit.direction @ ABOVE, -1, 1))))


def test_the_direction_is_found_and_the_colours_differ_as_they_do(found: SunFit) -> None:
    """Albedo is a factor of both lights, so only their ratio can be told."""
    assert degrees(found) < 4
    assert found.evidence > 2 * SunSearch().evidence
    wanted = SUN / SKY
    np.testing.assert_allclose(found.color / found.level, wanted, rtol=0.25)


def test_the_parts_add_up_to_the_photo(head: SunHead, found: SunFit) -> None:
    """Where it is lit: shadow, freckles and noise aside."""
    sun, rest = found.parts(head.surface.normal)
    photo = head.observation.image.reshape(-1, 3)[head.problem.pixel]
    lit = (head.visible * head.faced).ravel()[head.problem.pixel] > 0.99
    ratio = np.median((sun + rest)[lit] / photo[lit], axis=0)
    np.testing.assert_allclose(ratio, 1, atol=0.1)


def test_a_brim_the_mesh_knows_nothing_of_does_not_mislead() -> None:
    shaded = sun_head(SIZE, brim=0.42)
    fit = find_sun(shaded.problem, shaded.surface, SunSearch())
    assert fit is not None and degrees(fit) < 10
    assert fit.evidence > SunSearch().evidence


def test_an_even_light_is_no_sun() -> None:
    even = sun_head(SIZE, sun=np.zeros(3))
    fit = find_sun(even.problem, even.surface, SunSearch())
    assert fit is not None and fit.evidence < 0


def test_too_little_skin_says_nothing(head: SunHead) -> None:
    assert find_sun(head.problem, head.surface, SunSearch(brightest=0.01)) is None


@pytest.mark.parametrize(
    ("sun", "rest", "sky"),
    [
        ((1.0, 0.85, 0.6), (0.16, 0.19, 0.25), True),
        ((1.0, 1.0, 1.0), (0.2, 0.2, 0.2), False),  # one colour: a lamp
        ((1.0, 1.0, 1.0), (0.25, 0.2, 0.15), False),  # warmer shade: skin lights skin
        ((1.0, 0.85, 0.6), (0.016, 0.019, 0.025), False),  # a lamp in the dark
        ((1.0, 0.85, 0.6), (0.8, 0.95, 1.25), False),  # a cloud
        ((1.0, 0.85, 0.0), (0.16, 0.19, 0.25), False),
    ],
)
def test_sky_is_bluer_than_the_sun_and_weaker(sun: tuple, rest: tuple, sky: bool) -> None:
    assert as_sky(np.array(sun), np.array(rest), SunSearch()) is sky


@pytest.mark.parametrize("brim", [None, 0.42])
def test_the_shadow_is_where_the_photo_has_it(brim: float | None) -> None:
    """And without it the photo is that of unblocked sun, but for one colour and level."""
    head = sun_head(SIZE, brim=brim)
    fit = find_sun(head.problem, head.surface, SunSearch())
    assert fit is not None
    sun = sun_shadow(head.problem, head.surface, fit, head.observation, SunShadow())
    skin = head.faced
    told = (sun.visibility > 0.5) == (head.visible > 0.5)
    assert told[skin].mean() > 0.95
    shaded = skin & (head.visible < 0.1)
    assert (sun.visibility < 0.5)[shaded].mean() > 0.85
    off = ~head.problem.inside
    assert (sun.remaining[off] == 1).all()
    # Sun and sky become one colour, so brightness is compared, not each channel's.
    both = head.observation.image / sun.remaining, head.unblocked
    balanced, unblocked = (np.log(x[skin].mean(axis=1)) for x in both)
    photo = np.log(head.observation.image[skin].mean(axis=1))

    def spread(image: np.ndarray) -> float:
        return float(np.std(image - unblocked))

    assert spread(balanced) < 0.4 * spread(photo)


def test_the_shade_gets_the_colour_of_the_light(head: SunHead, found: SunFit) -> None:
    """Blue shade, yellow sun: without the shadow both have one colour."""
    sun = sun_shadow(head.problem, head.surface, found, head.observation, SunShadow())
    lit = head.faced & (head.visible > 0.99)
    shaded = head.faced & (head.visible < 0.01)

    def blue(image: np.ndarray) -> float:
        color = [np.median(image[w][:, 2] / image[w][:, 0]) for w in (lit, shaded)]
        return abs(float(np.log(color[1] / color[0])))

    before, after = head.observation.image, head.observation.image / sun.remaining
    assert blue(before) > 0.4
    assert blue(after) < 0.3 * blue(before)


def test_a_larger_photo_has_sharper_edges_and_the_same_shadow() -> None:
    """The search is on a small copy; along edges the photo itself tells."""
    large = sun_head(320)
    small = large.observation.reduced(SIZE)
    assert small.image.shape == (SIZE, SIZE, 3)
    reduced = replace(sun_head(SIZE), observation=small)
    fit = find_sun(reduced.problem, reduced.surface, SunSearch())
    assert fit is not None
    sun = sun_shadow(reduced.problem, reduced.surface, fit, large.observation, SunShadow())
    assert sun.visibility.shape == (320, 320)
    corners = np.ix_([0, -1], [0, -1])
    assert (sun.remaining[corners] == 1).all()
    told = (sun.visibility > 0.5) == (large.visible > 0.5)
    assert told[large.faced].mean() > 0.93


def test_trust_is_least_in_deep_shade_and_on_edges(head: SunHead, found: SunFit) -> None:
    """And none where the shade is black."""
    black = head.observation.image * (np.indices((SIZE, SIZE))[0] > SIZE / 2)[..., None]
    seen = replace(head.observation, image=black)
    sun = sun_shadow(head.problem, head.surface, found, seen, SunShadow())
    lit, shaded = sun.visibility > 0.99, sun.visibility < 0.01
    below = head.faced & (black.max(axis=2) > 0)
    assert sun.trust[below & shaded].max() < 0.8 * sun.trust[below & lit].max()
    edge = (sun.visibility > 0.4) & (sun.visibility < 0.6) & below
    assert edge.any() and sun.trust[edge].max() < 0.55
    deep = sun.remaining.min(axis=2) < 0.5
    assert not sun.trust[deep & (black.max(axis=2) == 0)].any()
    assert (sun.trust[~head.problem.inside] == 1).all()


def test_a_field_follows_the_edges_of_its_guide() -> None:
    """Noise of the evidence goes, and the edge is the guide's where the evidence has none."""
    rng = np.random.default_rng(0)
    columns = np.indices((40, 40))[1]
    guide = np.where(columns < 20, 0.0, -1.0) + 0.02 * rng.standard_normal((40, 40))
    evidence = np.select([columns < 15, columns < 25], [1.5, 0.0], -1.5)
    evidence += rng.standard_normal((40, 40))
    inside = np.ones((40, 40), bool)
    one = mean_field(evidence, guide, inside, 0.12, 1.0, 60)
    assert ((one > 0.5) == (columns < 20)).mean() > 0.97
    alone = mean_field(evidence, guide, inside, 0.12, 0.0, 60)
    np.testing.assert_allclose(alone, 1 / (1 + np.exp(-evidence)), atol=1e-3)
    nothing = mean_field(evidence, guide, ~inside, 0.12, 1.0, 60)
    np.testing.assert_allclose(nothing, alone, atol=1e-6)


def test_huber_is_smooth_where_it_turns_straight() -> None:
    x = np.array([0, 1, 1.4999, 1.5001, -3])
    np.testing.assert_allclose(huber(x), [0, 0.5, 1.125, 1.125, 3.375], atol=3e-4)


def test_a_sample_knows_the_darker_half(head: SunHead) -> None:
    sample = SkinSample.of(head.problem, head.surface.normal, SunSearch(samples=800))
    assert sample is not None and len(sample.rows) == 800
    level = sample.image.mean(axis=1)
    assert level[sample.dark].mean() < 0.6 * level[~sample.dark].mean()
    np.testing.assert_allclose(sample.mean @ np.ones(800), 1, rtol=1e-5)


def test_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    """auto asks for evidence, always does not, never does not look."""
    seen, asked = tiny_run.photo(), []
    weak = SunFit(np.array([0, 0, 1.0]), np.ones(3), np.zeros((4, 3)), np.ones(3), 0.01)
    size = len(seen.image)
    ones = np.ones((size, size), np.float32)
    even = ones, np.full((size, size, 3), 0.5, np.float32), 0.7 * ones
    sun, other = Shadow(*even, np.array([0, 0, 1], np.float32)), Shadow(*even)
    monkeypatch.setattr(module, "find_sun", lambda *_: asked.append(1) or weak)
    monkeypatch.setattr(module, "sun_shadow", lambda *_: sun)
    monkeypatch.setattr(module, "cast_shadow", lambda *_: other)

    def of(mode: str) -> Conditions:
        chosen = tiny_run.settings(**{"sun.mode": mode, "cast_shadow.mode": "auto"})
        return estimate_conditions(
            seen, tiny_run.head(), Photo.of(np.ones_like(seen.image)), chosen
        )

    # What the sun explains is not looked for as another shadow.
    assert of("never").shadow is other and not asked
    assert of("auto").shadow is other and len(asked) == 1
    found = of("always")
    assert found.shadow is sun
    seen_so = observation(seen, tiny_run.head(), found)
    np.testing.assert_allclose(seen_so.image, seen.image / 0.5)
    np.testing.assert_allclose(seen_so.weight, seen.regions.face * 0.7, rtol=1e-6)
    assert seen_so.sun is sun.sun
