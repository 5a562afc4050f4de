"""Table 1, the presets, and overriding them by name."""

from typing import Any

import pytest

from unlit.errors import SettingsError
from unlit.settings.settings import PRESETS, TABLE_1, Settings, as_dict, override


def test_table_1() -> None:
    """The paper's iterations, 5,350 in all, and a few of its weights and rates."""
    stages = PRESETS["paper"].stages()
    assert [s.iterations for s in stages] == [2000, 2000, 750, 500, 100]
    assert [s.specular_smoothness for s in stages] == [0, 10, 10, 10, 1]
    assert [s.diffuse_smoothness for s in stages] == [0, 1, 1, 1, 0.1]
    assert [s.axis_rate for s in stages] == [0.01, 0.01, 0.005, 0, 0]
    assert [s.normal for s in stages] == [0, 0, 0, 0.1, 0.1]
    assert PRESETS["paper"] == Settings(**TABLE_1)


def test_draft_is_the_same_in_less() -> None:
    """Fewer iterations at a lower resolution, the same weights."""
    paper, draft = PRESETS["paper"], PRESETS["draft"]
    assert draft.resolution < paper.resolution
    total = [sum(s.iterations for s in preset.stages()) for preset in (draft, paper)]
    assert total[0] < total[1] / 2
    for a, b in zip(draft.stages(), paper.stages(), strict=True):
        assert 0 < a.iterations <= b.iterations
        assert a.diffuse_smoothness == b.diffuse_smoothness


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
        ({"stage2": 5}, ["stage2", "stage2.iterations"]),
        ({"resolution.x": 5}, ["resolution.x", "no fields"]),
        ({"stage1.iterations": "many"}, ["stage1.iterations", "many", "int"]),
        ({"stage1.iterations": 2.5}, ["stage1.iterations", "2.5", "int"]),
        ({"stage1.iterations": -1}, ["stage1.iterations", "-1"]),
        ({"resolution": 100}, ["resolution=100", "256", "2048"]),
        ({"bounces": -1}, ["bounces=-1", "0 or more"]),
        ({"refresh_interval": 0}, ["refresh_interval=0", "1 or more"]),
        ({"clip": None}, ["clip", "None", "float"]),
        ({"stage1.iterations": "inf"}, ["stage1.iterations", "inf"]),
        ({"clip": "nan"}, ["clip", "nan"]),
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


def test_as_dict_round_trip() -> None:
    """The nested dictionary that is saved brings the same settings back."""
    changed = override(PRESETS["draft"], {"stage4.rate": 0.02, "bounces": 1})
    plain = as_dict(changed)
    assert plain["stage4"]["rate"] == 0.02
    assert override(PRESETS["paper"], plain) == changed
