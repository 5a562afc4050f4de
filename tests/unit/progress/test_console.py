"""What a run prints where there is no terminal, and what is kept as the log."""

import io

import pytest
from rich.console import Console

from unlit.progress import console as module
from unlit.progress.console import RunConsole, settings_block


class Clock:
    """Time that passes only when told."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def plain() -> tuple[RunConsole, io.StringIO]:
    stream = io.StringIO()
    return RunConsole({"stage1": 100, "stage2": 100}, Console(file=stream, width=200)), stream


def test_settings_are_all_there_and_aligned():
    """Every name and value; the stages' columns line up."""
    settings = {
        "resolution": 512,
        "stage1": {"iterations": 2000, "rate": 0.05},
        "stage2": {"iterations": 750, "rate": 0.01},
        "cast_shadow": {"mode": "auto", "dark": -0.45},
    }
    lines = settings_block(settings)
    assert [line.split() for line in lines] == [
        ["settings"],
        ["stage1", "stage2"],
        ["iterations", "2000", "750"],
        ["rate", "0.05", "0.01"],
        ["resolution", "512"],
        ["cast_shadow.mode", "auto"],
        ["cast_shadow.dark", "-0.45"],
    ]
    assert len({len(line) for line in lines[1:4]}) == 1


def test_plain_lines_tell_stage_iteration_loss_and_time_left(clock):
    """One line at the start of a stage, one every ten seconds, one at its end."""
    run, stream = plain()
    with run:
        run("photo", 0, 1, 0.0)
        clock.now = 5
        for iteration in range(1, 101):
            clock.now += 0.25
            run("stage1", iteration, 100, 1 / iteration)
        run("stage2", 1, 100, 0.5)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "0:00  reading the photo"
    assert [line.split("  ")[2] for line in lines[1:5]] == ["1/100", "41/100", "81/100", "100/100"]
    assert "loss 1.0000" in lines[1]
    assert lines[2].endswith(" left")
    assert lines[4] == "0:30  stage 1: base colour and light  100/100  loss 0.0100"
    assert "\x1b" not in stream.getvalue()
    assert run.log().splitlines() == [lines[4]]


def test_time_left_falls_to_nothing(clock):
    """Where stages cost what the table says, the estimate is right from the start."""
    run, _ = plain()
    shares = [run._share("stage1", 0.0), run._share("stage1", 1.0), run._share("stage2", 0.5)]
    shares += [run._share("stage2", 1.0), run._share("finish", 1.0)]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1)


def test_brackets_are_no_markup():
    """A photo may be called a[bold].jpg."""
    run, stream = plain()
    run.say("a[bold].jpg")
    assert stream.getvalue() == "a[bold].jpg\n"
    assert run.log() == "a[bold].jpg\n"


def test_a_terminal_gets_a_bar(clock):
    """The bar names stage, iteration and loss, and is gone at the end."""
    stream = io.StringIO()
    run = RunConsole({"stage1": 10}, Console(file=stream, width=120, force_terminal=True))
    with run:
        clock.now = 9
        run("stage1", 5, 10, 0.25)
        run._bar.refresh()
        assert "5/10  loss 0.2500" in stream.getvalue()
        assert "stage 1" in stream.getvalue()
