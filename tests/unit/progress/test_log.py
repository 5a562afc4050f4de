"""What is kept of a run."""

import pytest

from unlit.progress.log import Log, clock, settings_lines


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (61.6, "1:02"), (3600, "1:00:00")])
def test_clock(seconds, text):
    """Hours only where there are some."""
    assert clock(seconds) == text


def test_settings_are_all_there_and_aligned():
    """Every name and value; the stages' columns line up; other tables by their dotted names."""
    settings = {
        "resolution": 512,
        "stage1": {"iterations": 2000, "rate": 0.05},
        "stage2": {"iterations": 750, "ridge": 0.01},
        "fit": {"prior": 1.0},
    }
    lines = settings_lines(settings)
    assert [line.split() for line in lines] == [
        ["settings"],
        ["stage1", "stage2"],
        ["iterations", "2000", "750"],
        ["rate", "0.05"],
        ["ridge", "0.01"],
        ["resolution", "512"],
        ["fit.prior", "1.0"],
    ]
    assert len({len(line) for line in lines[1:5]}) == 1


def test_ends_of_stages_are_kept():
    """With their last loss; other steps are not; notes are kept without being shown."""
    shown = []
    log = Log(shown.append)
    log.note("a note")
    log("photo", 0, 1, 0.0)
    log("stage1", 9, 10, 0.5)
    log("stage1", 10, 10, 0.25)
    log("stage2", 1, 10, 0.125)
    assert shown == ["0:00  stage 1: base colour and light  10/10  loss 0.2500"]
    assert log.text() == f"a note\n{shown[0]}\n"
