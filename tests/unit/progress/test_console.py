"""What a run, a download and steps print, on a terminal, in a notebook and elsewhere."""

import io
from dataclasses import dataclass

import pytest
from rich.console import Console

from unlit.progress import console as consoles
from unlit.progress import log
from unlit.progress.console import FetchConsole, RunConsole, StepConsole, StudyConsole

PLAN = {"photo": 1, "stage1": 20, "stage2": 25, "finish": 4}


class Clock:
    """Time that passes only when told."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    for module in (consoles, log):
        monkeypatch.setattr(module, "time", clock)
    return clock


def plain() -> tuple[RunConsole, io.StringIO]:
    stream = io.StringIO()
    return RunConsole(PLAN, Console(file=stream, width=200)), stream


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
    assert run.log.text().splitlines() == [lines[4]]


def test_time_left_falls_to_nothing(clock):
    """Where steps take what the plan says, the estimate is right from the start."""
    run, stream = plain()
    for clock.now, step, part in ((1, "stage1", 0), (11, "stage1", 1), (33.5, "stage2", 1)):
        run(step, part, 2, 0.5)
    run("finish", 1, 1, 0.0)
    said = stream.getvalue().splitlines()
    assert said[1].endswith("0:39 left")
    assert said[-1].endswith("finish  0:00 left") or "0:00 left" in said[-1]


def test_brackets_are_no_markup():
    """A photo may be called a[bold].jpg."""
    run, stream = plain()
    run.log.say("a[bold].jpg")
    assert stream.getvalue() == "a[bold].jpg\n"
    assert run.log.text() == "a[bold].jpg\n"


def terminal(stream: io.StringIO, **options) -> Console:
    return Console(file=stream, width=120, force_terminal=True, **options)


def test_a_terminal_gets_a_bar(clock):
    """The bar names stage, iteration and loss; nothing stays of it after an error either."""
    stream = io.StringIO()
    run = RunConsole(PLAN, terminal(stream))
    with pytest.raises(KeyboardInterrupt), run:
        clock.now = 9
        run("stage1", 5, 10, 0.25)
        run._bar.refresh()
        assert "5/10  loss 0.2500" in stream.getvalue()
        assert "stage 1" in stream.getvalue()
        raise KeyboardInterrupt
    assert stream.getvalue().endswith("\x1b[?25h\r\x1b[1A\x1b[2K")  # cursor and line


@pytest.mark.parametrize("widgets", [False, True])
def test_a_notebook_gets_a_bar_where_it_can_draw_one(monkeypatch, widgets):
    """Rich draws it with ipywidgets, without which it would only warn."""
    found = object() if widgets else None
    monkeypatch.setattr(consoles.importlib.util, "find_spec", lambda name: found)
    assert RunConsole(PLAN, terminal(io.StringIO(), force_jupyter=True)).redraws is widgets


@dataclass(frozen=True)
class File:
    """What is fetched."""

    name: str
    size: int


def test_downloads(clock):
    """A line for each file with what is kept of it, then one every ten seconds."""
    stream = io.StringIO()
    console = Console(file=stream, width=200)
    small, part = File("a.bin", 10_000_000), File("b.bin", 10_000_000)
    with FetchConsole(console) as fetch:
        for clock.now, done in ((0, 1_000_000), (5, 5_000_000), (10, 10_000_000)):
            fetch(small, done, 10_000_000)
        fetch(part, 1_000_000, 60_000_000)
    assert stream.getvalue().splitlines() == [
        "fetching a.bin (10 MB)",
        "fetching a.bin: 10.0 of 10.0 MB",
        "fetching b.bin (60 MB, 10 MB of it kept)",
    ]


def test_steps(clock):
    """The first at once, others every ten seconds."""
    stream = io.StringIO()
    console = Console(file=stream, width=200)
    with StepConsole(console) as steps:
        for clock.now, what, done in ((0, "preparing", 0), (5, "a", 1), (10, "b", 2)):
            steps(what, done, 4)
    assert stream.getvalue().splitlines() == ["preparing", "b  2/4"]


def test_a_study(clock):
    """One line a step, and a face's own lines among them."""
    stream = io.StringIO()
    console = Console(file=stream, width=200)
    study = StudyConsole(PLAN, console)
    clock.now = 3
    with study.busy("reading"):
        pass
    with study.running("flash") as run:
        run("stage1", 1, 10, 0.5)
    said = stream.getvalue().splitlines()
    assert said[:2] == ["0:03  reading", "0:03  flash"]
    assert "1/10  loss 0.5000" in said[2]
