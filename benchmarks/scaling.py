"""Time and memory against pixels, cells of the light's quadrature, and threads.

    python benchmarks/scaling.py [--sizes 256,512,1024,2048] [--share 0.03]

Each row is a process of its own, which runs `share` of each stage's iterations on the default head
(benchmarks/speed.py) and says how the time of an iteration splits into Dr.Jit's kernels and the
rest (Python, BLAS, sparse products); the whole schedule is extrapolated from that. Then
`unlit demo` runs once per size with next to no iterations: what everything but the stages takes,
and the peak memory of the whole command.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from unlit.settings.table1 import TABLE_1


def row(size: int, cells: int, threads: int, share: float) -> dict[str, Any]:
    """Measured in this process: ms an iteration by stage, its kernels' share, peak memory."""
    import resource

    import speed

    # isort: split
    import drjit as dr

    dr.set_thread_count(threads)
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    begin = time.perf_counter()
    rows = speed.stages(speed.portrait(size), share, max_cells=cells)
    whole = time.perf_counter() - begin
    kernels = sum(k.get("execution_time", 0.0) for k in dr.kernel_history()) / 1000
    return {
        "pixels": rows.pop("pixels"),
        "pace": {name: pace for name, (pace, _) in rows.items()},
        "setup": sum(setup for _, setup in rows.values()),
        "kernels": kernels / whole,
        "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }


def in_process(size: int, cells: int, threads: int, share: float) -> dict[str, Any]:
    """`row` in a fresh process."""
    numbers = [str(v) for v in (size, cells, threads, share)]
    command = [sys.executable, __file__, "--one", *numbers]
    found = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(found.splitlines()[-1])


def command_row(size: int) -> tuple[float, float]:
    """Seconds of `unlit demo` outside its stages, and its peak memory, GB."""
    few = [f"--set=stage{k}.iterations=2" for k in range(1, 6)]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "unlit", "demo", "-o", folder, "--resolution", str(size)]
        begin = time.perf_counter()
        child = subprocess.Popen([*command, *few], stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(child.pid, 0)
        whole = time.perf_counter() - begin
        if status:
            raise SystemExit(f"unlit demo at {size} pixels failed")
        seconds = json.loads((Path(folder) / "metrics.json").read_text())["seconds"]
    stages = sum(value for name, value in seconds.items() if name in TABLE_1)
    return whole - stages, usage.ru_maxrss * 1024 / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", default="256,512,1024,2048", help="pixels on a side")
    parser.add_argument("--cells", default="700,1000,2000", help="of the light, at 512 pixels")
    parser.add_argument("--threads", default="1,2", help="at 512 pixels")
    parser.add_argument("--share", type=float, default=0.03, help="of each stage's iterations")
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        size, cells, threads = map(int, options.one[:3])
        print(json.dumps(row(size, cells, threads, float(options.one[3]))))
        return

    def numbers(text: str) -> list[int]:
        return [int(part) for part in text.split(",") if part]

    cores = len(os.sched_getaffinity(0))
    trials = [(size, 1000, cores) for size in numbers(options.sizes)]
    trials += [(512, cells, cores) for cells in numbers(options.cells)]
    trials += [(512, 1000, threads) for threads in numbers(options.threads)]
    heads = ["pixels", "cells at most", "threads", "face pixels", "ms an iteration, stages 1 to 5"]
    heads += ["in kernels", "stages' schedule", "stages' memory"]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for size, cells, threads in dict.fromkeys(trials):
        found = in_process(size, cells, threads, options.share)
        paces = " / ".join(f"{found['pace'][name]:.0f}" for name in TABLE_1)
        iterations = sum(found["pace"][n] / 1000 * s.iterations for n, s in TABLE_1.items())
        print(
            f"| {size} | {cells} | {threads} | {found['pixels']} | {paces} "
            f"| {100 * found['kernels']:.0f} % | {found['setup'] + iterations:.0f} s "
            f"| {found['gigabytes']:.2f} GB |",
            flush=True,
        )
    print("\n| pixels | the command without the stages | its peak memory |\n|---|---|---|")
    for size in numbers(options.sizes):
        seconds, gigabytes = command_row(size)
        print(f"| {size} | {seconds:.0f} s | {gigabytes:.2f} GB |", flush=True)


if __name__ == "__main__":
    main()
