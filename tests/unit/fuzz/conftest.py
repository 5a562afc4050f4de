"""Every fuzz test: bounded time and memory; the seeds are fixed, so that runs are alike."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "fuzz",
    deadline=None,
    derandomize=True,
    max_examples=80,
    suppress_health_check=list(HealthCheck),
)
#: The seeds are of a few kilobytes: what takes more than this trusted a number in a header.
_MEGABYTES = 700


def _resident(field: str) -> int:
    """Kilobytes of this process: VmRSS now, VmHWM at most since the last reset."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{field}:"))


@pytest.fixture(autouse=True)
def little_memory():
    """The test's own peak is not more than `_MEGABYTES` above what was there before it."""
    if not Path("/proc/self/clear_refs").exists():
        yield
        return
    Path("/proc/self/clear_refs").write_text("5")  # begins the peak anew
    before = _resident("VmRSS")
    yield
    assert _resident("VmHWM") - before < _MEGABYTES << 10
