"""What a reconstruction will take of a machine, said before it starts: memory and time.

Both grow with the pixels of the crop. The pace of Adam's stages is that of benchmarks/scaling.py
on two cores of a server; memory, the pace of the others and the rest are what commands took there
(docs/lab/method-notes-speed.md); another machine is faster or slower by a factor, and the
progress bar measures it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from ..errors import SettingsError

#: Peak memory of the whole command: bytes, and bytes more for each pixel of the crop.
_MEMORY, _MEMORY_PER_PIXEL = 0.86e9, 480.0
#: By solver: milliseconds of an iteration, and more for each million pixels of the crop, on two
#: cores. Then the share of what else there is, which is taken by its set-up and preview.
_PACE = {
    "adam": {
        "stage1": (8.5, 5.0, 0.14),
        "stage2": (10.0, 27.0, 0.15),
        "stage3": (24.0, 95.0, 0.24),
        "stage4": (1.0, 85.0, 0.03),
        "stage5": (1.0, 72.0, 0.04),
    },
    "primal-dual": {
        "stage1": (18.0, 8.0, 0.08),
        "stage2": (50.0, 50.0, 0.15),
        "stage3": (50.0, 180.0, 0.18),
        "stage4": (18.0, 60.0, 0.08),
        "stage5": (18.0, 75.0, 0.05),
    },
}
_CORES = 2
#: By solver: seconds of everything but the iterations, and more for each million pixels.
_REST = {"adam": (40.0, 30.0), "primal-dual": (28.0, 55.0)}
#: Who else takes them.
_BEFORE = {"photo": 0.01, "perception": 0.01, "fit": 0.07, "conditions": 0.10}
_AFTER = {"finish": 0.21}

_UNITS = {"GB": 1e9, "GIB": 2.0**30, "MB": 1e6, "MIB": 2.0**20}


def memory(resolution: int) -> float:
    """Peak memory, bytes, of a reconstruction with a crop of `resolution` pixels a side."""
    return _MEMORY + _MEMORY_PER_PIXEL * resolution**2


def plan(
    resolution: int, iterations: Mapping[str, int], cores: int, solver: str
) -> dict[str, float]:
    """Rough seconds of each step in order, for `iterations` of some of "stage1" to "stage5".

    Measured on one and two cores; up to four are taken to help as much, more not at all.
    """
    megapixels = resolution**2 / 1e6
    rest = _REST[solver][0] + _REST[solver][1] * megapixels
    speed = min(cores, 4) / _CORES
    stages = {
        step: count * (each + more * megapixels) / 1000 + share * rest
        for step, (each, more, share) in _PACE[solver].items()
        if (count := iterations.get(step)) is not None
    }
    before, after = ({step: s * rest for step, s in part.items()} for part in (_BEFORE, _AFTER))
    return {step: seconds / speed for step, seconds in (before | stages | after).items()}


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_memory(limit: float, resolution: int) -> None:
    """Raise SettingsError where a crop of `resolution` takes more than `limit` bytes."""
    if memory(resolution) <= limit:
        return
    fitting = [side for side in (1536, 1024, 768, 512, 384, 256) if memory(side) <= limit]
    least = f"no resolution takes less than the {memory(256) / 1e9:.2f} GB of 256 pixels"
    remedy = f"use resolution={fitting[0]}" if fitting else f"allow more: {least}"
    taken = f"{resolution} pixels are taken to need {memory(resolution) / 1e9:.2f} GB"
    raise SettingsError(f"{limit / 1e6:.0f} MB of memory: {taken}; {remedy}", "memory")


def read_size(text: str) -> float:
    """Bytes of "4GB", "900MB" or "2GiB". Raises ValueError, also without a unit."""
    number = text.strip().upper()
    for unit, factor in _UNITS.items():
        if number.endswith(unit):
            size = float(number.removesuffix(unit)) * factor
            if 0 < size < float("inf"):
                return size
    raise ValueError("no size, or no unit")
