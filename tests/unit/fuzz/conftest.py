"""Every fuzz test: bounded time and memory; the seeds are fixed, so that runs are alike."""

import resource

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


@pytest.fixture(autouse=True)
def little_memory():
    """The peak of this process does not rise by more than `_MEGABYTES`."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < _MEGABYTES << 10
