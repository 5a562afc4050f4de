"""What is kept of a run as it goes."""

import pytest

from unlit.optimize import run_record
from unlit.optimize.run_record import RunRecord


def test_losses_are_kept_and_passed_on():
    """By stage, counted from 0, as they are reported from 1."""
    told = []
    run = RunRecord(lambda *said: told.append(said))
    run.begins("fit")
    run("stage1", 1, 50, 0.5)
    run("stage1", 26, 50, 0.25)
    run("stage2", 1, 10, 0.125)
    assert told[0] == ("fit", 0, 1, 0.0)
    assert told[1:] == [
        ("stage1", 1, 50, 0.5),
        ("stage1", 26, 50, 0.25),
        ("stage2", 1, 10, 0.125),
    ]
    assert run.losses == {"stage1": [(0, 0.5), (25, 0.25)], "stage2": [(0, 0.125)]}


def test_times_between_laps_belong_to_their_steps(monkeypatch):
    """A step's laps add up, and none is counted twice."""
    now = iter((10.0, 11.0, 13.0, 16.0))
    monkeypatch.setattr(run_record.time, "perf_counter", lambda: next(now))
    run = RunRecord(lambda *_: None)
    for step in ("fit", "preview", "fit"):
        run.lap(step)
    assert run.seconds == {"fit": 4.0, "preview": 2.0}


def test_what_its_listener_raises_ends_the_run():
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        RunRecord(stop)("stage1", 1, 2, 0.5)
