"""What a batch says while it runs."""

import io
import time
from collections import Counter

import pytest
from rich.console import Console

pytest.importorskip("distributed", reason="needs the extra 'batch'")


from unlit.batches.record import BatchRow
from unlit.batches.run import Counts
from unlit.batches.working import PhotoProgress
from unlit.cli.batch_console import BatchConsole


def test_it_is_told_what_runs_before_the_first_photo_is_done(monkeypatch) -> None:
    """At once, then every minute; in between only what is done."""
    text, now = io.StringIO(), [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    with BatchConsole(Console(file=text, width=200)) as watch:
        watch(Counts(3), [])
        assert text.getvalue() == ""
        for second in range(0, 100, 2):
            now[0] = float(second)
            watch(Counts(3, workers=2, running=2, longest=float(second)), [])
        watch(
            Counts(3, done=1, workers=2, running=1, longest=100.0), [BatchRow("a.jpg", folder="a")]
        )
    said = text.getvalue().splitlines()
    assert said[0] == "0 of 3, 2 workers, 2 running for up to 0:00"
    assert said[1] == "0 of 3, 2 workers, 2 running for up to 1:00"
    assert said[2].startswith("done  a  ")
    assert said[3:] == ["1 of 3"]


def test_it_says_at_the_end_what_was_done_before() -> None:
    text = io.StringIO()
    with BatchConsole(Console(file=text, width=200)) as watch:
        watch(Counts(5, before=3, failed=2), [])
    assert text.getvalue().splitlines() == ["5 of 5, 3 done before, 2 failed"]


def test_it_says_once_why_photos_are_done_again() -> None:
    """Before the first of them; not a line for each photo."""
    anew = Counter({"another head model": 1, "another version of unlit (other code)": 4})
    text = io.StringIO()
    with BatchConsole(Console(file=text, width=200)) as watch:
        for running in (1, 2):
            watch(Counts(5, workers=2, running=running, anew=anew), [])
    assert text.getvalue().splitlines()[:3] == [
        "anew  1 photo: the earlier result is of another head model",
        "anew  4 photos: the earlier result is of another version of unlit (other code)",
        "0 of 5, 2 workers, 1 running for up to 0:00",
    ]


def test_on_a_terminal_each_worker_has_a_line() -> None:
    """Step and time left; the line goes when there is nothing to tell any more."""
    text = io.StringIO()
    console = Console(file=text, width=120, force_terminal=True)
    working = [
        PhotoProgress("a", "a", "stage3", 0.6, 42.0),
        PhotoProgress("b", "b", "fit", 0.1, None),
    ]
    with BatchConsole(console) as watch:
        watch(Counts(5, workers=2, running=2, working=working), [])
        watch._bar.refresh()
        shown = text.getvalue()
        watch(Counts(5, workers=2, running=1, working=[]), [])
        text.truncate(0)
        watch._bar.refresh()
    assert "a  stage 3: shape  0:42 left" in shown
    assert "b  fitting the head" in shown
    assert "stage 3" not in text.getvalue()
