"""Table 1, the presets, and overriding them by name."""

import dataclasses
import math
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import pytest
import tomli_w
from msgspec import Meta

from unlit.errors import SettingsError
from unlit.head.skin_regions import SKIN_REGIONS
from unlit.perception.regions import REGIONS
from unlit.settings.conditions import KnownExposure, LightColorRequest
from unlit.settings.regions import RoughnessByRegion, SpecularByRegion
from unlit.settings.settings import PRESETS, Settings, as_dict, flat, override
from unlit.settings.table1 import TABLE_1


def test_table_1() -> None:
    """The paper's iterations, 5,350 in all, and a few of its weights and rates."""
    stages = PRESETS["paper"].stages()
    assert [s.iterations for s in stages] == [2000, 2000, 750, 500, 100]
    assert [s.specular_smoothness for s in stages] == [0, 10, 10, 10, 1]
    assert [s.diffuse_smoothness for s in stages] == [0, 1, 1, 1, 0.1]
    assert [s.axis_rate for s in stages] == [0.01, 0.01, 0.005, 0, 0]
    assert [s.normal for s in stages] == [0, 0, 0, 0.1, 0.1]
    assert PRESETS["paper"] == Settings()
    assert stages == tuple(TABLE_1.values())


def test_standard_has_the_weights_of_table_1() -> None:
    """It takes other steps, and fewer; draft is the same, coarser."""
    paper, standard, draft = (PRESETS[name] for name in ("paper", "standard", "draft"))
    total = [sum(s.iterations for s in preset.stages()) for preset in (standard, paper)]
    assert total[0] < total[1] / 10
    weights = ("image", "specular_smoothness", "diffuse_smoothness", "landmark", "shape", "normal")
    for a, b in zip(standard.stages(), paper.stages(), strict=True):
        assert 0 < a.iterations <= b.iterations
        assert all(getattr(a, weight) == getattr(b, weight) for weight in weights)
    assert draft.resolution < standard.resolution
    assert dataclasses.replace(draft, resolution=standard.resolution) == standard


@pytest.mark.parametrize(
    "text, value", [(".5", 0.5), ("0.5", 0.5), ("5e-1", 0.5), (" .25", 0.25), ("1.5", 1.5)]
)
def test_numbers_as_people_write_them(text: str, value: float) -> None:
    assert override(Settings(), {"shading_error": text}).shading_error == value
    negative = override(Settings(), {"cast_shadow.dark": f"-{text.strip()}"})
    assert negative.cast_shadow.dark == -value
    two = override(Settings(), {"landmark_fit.dim": f"{text}, 2.5"}).landmark_fit.dim
    assert two == (value, 2.5)
    color = override(Settings(), {"light_color": "1,.5,.25"}).light_color
    assert color.rgb == (1, 0.5, 0.25)


def test_a_file_whose_name_begins_with_a_dot_keeps_it() -> None:
    assert override(Settings(), {"head_model": "heads/.5.npz"}).head_model == "heads/.5.npz"


def test_override_by_dotted_name() -> None:
    """Text, numbers and nested tables (as TOML gives them); the original stays."""
    paper = PRESETS["paper"]
    changed = override(
        paper,
        {"stage2.iterations": "500", "resolution": 256, "stage3": {"shape": 20, "rate": "0.1"}},
    )
    assert changed.stage2.iterations == 500
    assert changed.resolution == 256
    assert (changed.stage3.shape, changed.stage3.rate) == (20.0, 0.1)
    assert changed.stage1 == paper.stage1
    assert paper.stage2.iterations == 2000
    assert override(paper, {}) == paper


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speed": 1}, ["speed", "no such setting", "resolution"]),
        ({"stage2.speed": 1}, ["stage2.speed", "no such setting", "iterations"]),
        ({"stage2.iteration": 1}, ["stage2.iteration:", "did you mean stage2.iterations?"]),
        ({"stage2": {"iteration": 1}}, ["stage2.iteration:", "did you mean stage2.iterations?"]),
        ({"seed": 1}, ["seed: no such setting"]),
        ({"stage2": 5}, ["stage2", "stage2.iterations"]),
        ({"cast_shadow": "keep"}, ["cast_shadow: name one of its fields", "cast_shadow.mode"]),
        ({"cast_shadow.mode": "fill"}, ["cast_shadow.mode='fill'", "auto or keep"]),
        ({"resolution.x": 5}, ["resolution.x", "no fields"]),
        ({"light_color.kelvin": 5}, ["light_color.kelvin", "no fields"]),
        ({"light_color": {"text": "auto"}}, ["light_color={", "text"]),
        ({"light_color": 2700}, ["light_color=2700", "text"]),
        ({"light_color": "warm"}, ["light_color='warm'", "2700K", "#rrggbb"]),
        ({"exposure": "bright"}, ["exposure='bright'", "skin=ALBEDO", "500lux"]),
        ({"stage1.iterations": "many"}, ["stage1.iterations", "many", "int"]),
        ({"stage1.iterations": 2.5}, ["stage1.iterations", "2.5", "int"]),
        ({"stage1.iterations": True}, ["stage1.iterations=True", "int"]),
        ({"stage1.iterations": -1}, ["stage1.iterations", "-1"]),
        ({"resolution": 100}, ["resolution=100", "256", "2048"]),
        ({"resolution": 16**5000}, ["resolution=a long number"]),
        ({"bounces": -1}, ["bounces=-1", "0 or more"]),
        ({"refresh_interval": 0}, ["refresh_interval=0", "1 or more"]),
        ({"clip": None}, ["clip", "None", "float"]),
        ({"stage1.iterations": "inf"}, ["stage1.iterations", "inf"]),
        ({"landmark_fit.dim": [0.1]}, ["landmark_fit.dim=[0.1]", "a list of 2", "above 0"]),
        ({"landmark_fit.dim": [0.4, 0.4]}, ["landmark_fit.dim", "larger than the first"]),
        ({"min_sharpness": 700}, ["min_sharpness=700", "600"]),
        ({"head_model": 5}, ["head_model=5", "str"]),
    ],
)
def test_mistakes_are_named(changes: dict[str, Any], words: list[str]) -> None:
    """One line that says which setting is wrong and what would be right."""
    with pytest.raises(SettingsError) as error:
        override(PRESETS["paper"], changes)
    message = str(error.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def numbers(group: type = Settings, prefix: str = "") -> Iterator[tuple[str, type, Meta]]:
    """Every number that can be set: its dotted name, int or float, and its range."""
    for name, kind in get_type_hints(group, include_extras=True).items():
        if dataclasses.is_dataclass(kind) and kind not in (LightColorRequest, KnownExposure):
            assert isinstance(kind, type)
            yield from numbers(kind, f"{prefix}{name}.")
        elif get_origin(kind) is Annotated:
            yield (prefix + name, *get_args(kind))
        else:
            assert kind not in (int, float), f"{prefix}{name} has no range"


NUMBERS = {name: (kind, bounds) for name, kind, bounds in numbers()}


@pytest.mark.parametrize("name", NUMBERS)
def test_ranges_at_their_ends(name: str) -> None:
    """The last value inside is taken, as a number and as text; the next one, and nan, are not."""
    kind, bounds = NUMBERS[name]
    partner = {"min_sharpness": {"max_sharpness": 1e5}, "max_sharpness": {"min_sharpness": 1e-3}}
    changes = partner.get(name, {})

    def taken(value: Any) -> bool:
        try:
            changed = override(Settings(), changes | {name: value})
        except SettingsError as error:
            assert str(error).startswith(f"{name}={value!r}: expected {kind.__name__}, ")
            return False
        return flat(as_dict(changed))[name] == kind(float(value))

    assert taken(flat(as_dict(Settings()))[name])
    assert taken(flat(as_dict(PRESETS["draft"]))[name])
    for closed, opened, away in (
        (bounds.ge, bounds.gt, -math.inf),
        (bounds.le, bounds.lt, math.inf),
    ):
        end = closed if opened is None else opened
        assert end is not None, "a range has two ends"
        within, beyond = (
            (end - 1, end + 1)
            if kind is int
            else (math.nextafter(end, -math.inf), math.nextafter(end, math.inf))
        )
        if away < 0:
            within, beyond = beyond, within
        assert taken(end) == taken(str(end)) == (opened is None)
        assert taken(within)
        assert not taken(beyond)
        assert not taken(away)
    assert not taken(math.nan)
    assert not taken("nan")


def test_lists() -> None:
    """As lists and as text with commas; of a range each."""
    for said in ([0.2, 0.5], "0.2, 0.5"):
        assert override(Settings(), {"landmark_fit.dim": said}).landmark_fit.dim == (0.2, 0.5)
    assert override(Settings(), {"shading_fit.turns": ""}).shading_fit.turns == ()
    for said in ([0.2, 1.5], "0.2,nan"):
        with pytest.raises(SettingsError, match=r"shading_fit.turns=.*any number.*at most 1"):
            override(Settings(), {"shading_fit.turns": said})


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"stage4.rate": 0.02, "bounces": 1},
        {"light_color": "2700K", "exposure": "812,640.5 = 0.2", "cast_shadow.mode": "keep"},
        {"light_color": "#FFB46B", "shading_fit.turns": [], "landmark_fit.dim": (0.2, 0.3)},
    ],
)
def test_what_is_saved_brings_the_same_settings_back(changes: dict[str, Any]) -> None:
    """By way of TOML, as in reconstruction.toml; in plain values of the same types."""
    changed = override(PRESETS["draft"], changes)
    plain = as_dict(changed)
    saved = tomllib.loads(tomli_w.dumps(plain))
    assert saved == plain
    assert override(PRESETS["paper"], saved) == changed
    assert override(PRESETS["paper"], flat(plain)) == changed


def test_the_import_is_light() -> None:
    """No renderer, no arrays: the command line's help is made from it."""
    code = "import sys, unlit.settings.settings\n"
    code += "assert not {'numpy', 'drjit', 'mitsuba', 'scipy', 'cv2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_region_has_a_roughness_and_skin_a_level() -> None:
    assert {f.name for f in fields(RoughnessByRegion)} == {*SKIN_REGIONS, *REGIONS}
    assert tuple(f.name for f in fields(SpecularByRegion)) == SKIN_REGIONS
    changed = override(Settings(), {"roughness.nose": ".24", "specular_level": {"ears": 2}})
    assert (changed.roughness.nose, changed.specular_level.ears) == (0.24, 2.0)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("roughness.nose", 0, "float, 0.02 or more, at most 1"),
        ("specular_level.chin", 11, "float, 0.05 or more, at most 10"),
    ],
)
def test_what_a_region_cannot_have_is_refused(name: str, value: float, expected: str) -> None:
    with pytest.raises(SettingsError, match=re.escape(f"{name}={value}: expected {expected}")):
        override(Settings(), {name: value})
