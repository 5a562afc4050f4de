"""Settings files and --set: SettingsError, or settings that are in their bounds."""

import argparse
import dataclasses
import math
import os
from pathlib import Path

import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from corrupt import damaged
from unlit.cli.settings import add_settings, settings_of
from unlit.errors import SettingsError
from unlit.settings.settings import PRESETS, as_dict

FUZZ = settings.get_profile("fuzz")
TEXT = tomli_w.dumps(as_dict(PRESETS["draft"]))


def check(*arguments: str) -> None:
    parser = argparse.ArgumentParser()
    add_settings(parser, "draft")
    try:
        found = settings_of(parser.parse_args(arguments))
    except SettingsError as error:
        assert "\n" not in str(error)
        return
    assert 256 <= found.resolution <= 2048
    for stage in found.stages():
        assert stage.iterations >= 0
        assert all(math.isfinite(value) for value in dataclasses.astuple(stage))


@settings(FUZZ)
@given(damaged([TEXT.encode(), f"[settings]\n{TEXT.split('[')[0]}".encode()], head=3000))
def test_damaged_files(tmp_path_factory, content):
    """Any damage to a file that was whole."""
    path = tmp_path_factory.getbasetemp() / "settings.toml"
    path.write_bytes(content)
    check("--config", str(path))


VALUES = st.sampled_from(
    [
        *("1", "-1", "0", "nan", "-inf", "1e300", "true", '""', '"x"', "[]", "{}", "[[]]", "0x10"),
        *("9" * 400, "-" + "9" * 400, "1979-05-27", "07:32:00", "{ iterations = 1 }", "1.5"),
        *('"9e9999"', '"١٢"', '"1_0"', "{ a.b = 1 }", "{ iterations = [] }"),
    ]
)
NAMES = st.sampled_from(
    [
        *("resolution", "stage1", "stage1.iterations", "clip", '"stage1.iterations"'),
        *("landmark_fit.dim", "shading_fit.turns", "cast_shadow.mode", "light_color", "exposure"),
        *('""', "settings", "light_points", '"."', "stage1.x.y", "resolution.x"),
    ]
)


@settings(FUZZ)
@given(st.lists(st.tuples(NAMES, VALUES), max_size=4))
def test_values_of_wrong_types(tmp_path_factory, lines):
    """Any value for any name, known or not."""
    path = tmp_path_factory.getbasetemp() / "typed.toml"
    path.write_text("\n".join(f"{name} = {value}" for name, value in lines))
    check("--config", str(path))


@settings(FUZZ)
@given(NAMES, VALUES | st.text(max_size=20))
def test_values_on_the_command_line(name, value):
    """The same through --set."""
    check(f"--set={name.strip(chr(34))}x={value}")
    check(f"--set={name.strip(chr(34)) or 'x'}={value.strip(chr(34))}")


def test_files_made_to_last(tmp_path):
    """Keys of a hundred thousand parts, deep nesting, a file without end, and no file."""
    path: Path = tmp_path / "x.toml"
    for text in ("a." * 100_000 + "a = 1", "a = " + "[" * 100_000, "a = " + "9" * 5000):
        path.write_text(text)
        check("--config", str(path))
    path.unlink()
    os.symlink("/dev/zero", path)  # noqa: PTH211
    check("--config", str(path))
    for missing in ("no.toml", "a\0b", str(tmp_path)):
        check("--config", missing)


@pytest.mark.parametrize("name", ["resolution", "stage1.iterations", "clip"])
def test_numbers_beyond_any_float(tmp_path, name):
    """TOML's whole numbers have no bounds."""
    (tmp_path / "x.toml").write_text(f"{name} = 1{400 * '0'}")
    check("--config", str(tmp_path / "x.toml"))
