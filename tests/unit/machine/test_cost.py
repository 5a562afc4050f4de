"""What a run is said to take before it starts."""

import pytest

from unlit.cli import main
from unlit.errors import SettingsError
from unlit.machine.cost import check_memory, memory, plan, read_size
from unlit.settings.settings import PRESETS


@pytest.mark.parametrize(("text", "size"), [("4GB", 4e9), (" 900 mb", 9e8), ("2GiB", 2**31)])
def test_sizes(text: str, size: float) -> None:
    """Decimal and binary units, and plain bytes."""
    assert read_size(text) == size


@pytest.mark.parametrize("text", ["", "GB", "four", "4", "1e9", "-1GB", "0", "nan", "inf"])
def test_no_sizes(text: str) -> None:
    """Anything else is a ValueError, which argparse turns into one line."""
    with pytest.raises(ValueError, match=r".*"):
        read_size(text)


def test_remedy_fits() -> None:
    """A limit that is too low is refused with a resolution that does fit, or with the least."""
    check_memory(1e9, 512)
    check_memory(memory(2048), 2048)
    limit = memory(2048) - 1
    with pytest.raises(SettingsError, match=r"memory: 2048 pixels .* resolution=") as refused:
        check_memory(limit, 2048)
    check_memory(limit, int(str(refused.value).split("=")[-1]))
    with pytest.raises(SettingsError, match="256 pixels"):
        check_memory(1e6, 512)


def test_seconds_grow() -> None:
    """With pixels and iterations; halved by twice the cores."""

    def seconds(resolution: int, iterations: int, cores: int) -> float:
        return sum(plan(resolution, {"stage2": iterations}, cores, "adam").values())

    base = seconds(512, 1000, 2)
    assert seconds(1024, 1000, 2) > base
    assert seconds(512, 2000, 2) > base
    assert seconds(512, 1000, 4) == pytest.approx(base / 2)


def test_plan() -> None:
    """Every step in order; stages that are not run again take nothing."""
    whole = {f"stage{k}": 100 for k in range(1, 6)}
    steps = ["photo", "perception", "fit", "conditions", *whole, "finish"]
    assert list(plan(512, whole, 2, "adam")) == steps
    rest = plan(512, {"stage4": 100, "stage5": 100}, 2, "adam")
    assert list(rest) == [step for step in steps if step not in ("stage1", "stage2", "stage3")]
    none = plan(512, dict.fromkeys(whole, 0), 2, "adam")
    assert sum(none.values()) == pytest.approx(40 + 30 * 0.512**2)


@pytest.mark.parametrize(("preset", "seconds"), [("paper", 145), ("standard", 59), ("draft", 44)])
def test_presets_take_what_was_measured(preset: str, seconds: float) -> None:
    """To 25 %: whole commands on two cores."""
    settings = PRESETS[preset]
    expected = sum(plan(settings.resolution, settings.iterations(), 2, settings.solver).values())
    assert expected == pytest.approx(seconds, rel=0.25)


def test_memory_option_is_checked_before_anything_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """--memory that is too little ends with one line, before the photo is looked for."""
    code = main(["reconstruct", "no.jpg", "-o", "x", "--resolution", "2048", "--memory", "1.5GB"])
    assert code == 2
    assert "use resolution=1024 (option --memory)" in capsys.readouterr().err
