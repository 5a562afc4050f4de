"""Batches on real Dask processes: workers that are killed, Ctrl-C, and a scheduler that is lost.

The reconstruction is a stand-in (tests/batch_stand_in.py), which every worker loads; the last
test runs the real one on forty photos.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage.data import astronaut

import batch_stand_in
from batch_stand_in import noted, picture
from unlit.storage.folder import MARK

pytest.importorskip("distributed", reason="needs the extra 'batch'")

WAIT = 240.0
Process = subprocess.Popen


def until(condition: Callable[[], object], what: str, seconds: float = WAIT) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"no {what} in {seconds} s"
        time.sleep(0.05)


def start(*arguments: str, env: dict[str, str] | None = None) -> Process[str]:
    """A Python process in a process group of its own, as a terminal starts it."""
    return subprocess.Popen(
        [sys.executable, "-m", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | (env or {}),
        start_new_session=True,
    )


def kill(process: Process[str], number: int = signal.SIGKILL) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)


def stand_in(log: Path, seconds: float) -> dict[str, str]:
    """The environment in which Dask's workers reconstruct in `seconds`, noting it in `log`."""
    return {
        batch_stand_in.LOG: str(log),
        batch_stand_in.SECONDS: str(seconds),
        "DASK_DISTRIBUTED__WORKER__PRELOAD": str(Path(batch_stand_in.__file__)),
    }


@contextlib.contextmanager
def dask(folder: Path, workers: int, env: dict[str, str]) -> Iterator[tuple[str, list[Process]]]:
    """A scheduler and workers: its address, and all processes, the scheduler first."""
    file = folder / "scheduler.json"
    scheduler = ("dask", "scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard")
    worker = ("dask", "worker", "--nthreads", "1", "--no-dashboard", "--memory-limit", "0")
    processes = [start(*scheduler, "--scheduler-file", str(file))]
    try:
        until(lambda: file.exists() and file.read_text().strip(), "scheduler")
        for _ in range(workers):
            place = ("--scheduler-file", str(file), "--local-directory", str(folder))
            processes.append(start(*worker, *place, env=env))
        yield json.loads(file.read_text())["address"], processes
    finally:
        for process in processes:
            kill(process)
            process.communicate()


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    for k in range(10):
        picture(tmp_path / "photos" / f"{k}.png", (10 * k, 60, 60))
    return tmp_path / "photos"


def batch(photos: Path, folder: Path, *options: str, env: dict[str, str] | None = None) -> Process:
    return start("unlit", "batch", str(photos), "-o", str(folder), *options, env=env)


def finished(process: Process[str], code: int) -> tuple[str, str]:
    """Standard output and error of a batch that ends with `code`."""
    out, err = process.communicate(timeout=WAIT)
    assert process.returncode == code, err
    assert "Traceback" not in err
    return out, err


def statuses(folder: Path) -> Counter[str]:
    with (folder / "batch.csv").open() as file:
        return Counter(line["status"] for line in csv.DictReader(file))


def begun_by(log: Path) -> list[tuple[str, int]]:
    """Photo and process of every begin, in order."""
    lines = [line.split() for line in log.read_text().splitlines()] if log.exists() else []
    return [(words[1], int(words[2])) for words in lines if words[0] == "begin"]


def test_a_worker_is_killed(photos: Path, tmp_path: Path) -> None:
    """Of two workers one dies in the middle of a photo: every photo is done, none twice."""
    log, folder = tmp_path / "log", tmp_path / "out"
    with dask(tmp_path, 2, stand_in(log, 1.0)) as (address, processes):
        run = batch(photos, folder, "--scheduler", address)
        until(lambda: len(noted(log, "end")) >= 2 and len(begun_by(log)) > 3, "progress")
        begun, victim = begun_by(log)[-1]
        group = next(p for p in processes[1:] if os.getpgid(victim) == p.pid)
        kill(group)
        out, _ = finished(run, 0)
        assert out.strip() == str(folder / "batch.html")
        assert Counter(noted(log, "end")) == {f"{k}.png": 1 for k in range(10)}
        assert Counter(photo for photo, _ in begun_by(log)) - Counter(noted(log, "end")) == {
            begun: 1
        }
        assert statuses(folder) == {"done": 10}
        finished(batch(photos, folder, "--scheduler", address), 0)
    assert len(begun_by(log)) == 11


def test_the_scheduler_is_lost(photos: Path, tmp_path: Path) -> None:
    """One line, and what was done is done: the same call without it does the rest."""
    log, folder = tmp_path / "log", tmp_path / "out"
    env = stand_in(log, 0.5)
    with dask(tmp_path, 1, env) as (address, processes):
        run = batch(photos, folder, "--scheduler", address)
        until(lambda: len(noted(log, "end")) >= 2, "progress")
        kill(processes[0])
        _, err = finished(run, 1)
    assert "scheduler was lost" in err.splitlines()[-1]
    done = statuses(folder)["done"]
    assert 1 <= done < 10
    finished(batch(photos, folder, env=env), 0)
    assert statuses(folder) == {"done": 10}
    assert sum(Counter(noted(log, "end")).values()) <= 11


def test_ctrl_c_stops_cleanly_and_the_next_call_goes_on(photos: Path, tmp_path: Path) -> None:
    """The signal reaches all processes, as from a terminal; none is left, nor half a result."""
    log, folder = tmp_path / "log", tmp_path / "out"
    env = stand_in(log, 1.0)
    run = batch(photos, folder, env=env)
    until(lambda: len(noted(log, "end")) >= 2, "progress")
    workers = {process for _, process in begun_by(log)}
    kill(run, signal.SIGINT)
    began = time.monotonic()
    _, err = finished(run, 130)
    assert "interrupted" in err
    assert time.monotonic() - began < 60
    until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers), "end")
    assert not list(folder.rglob(".unlit-*"))
    done = len(list(folder.glob(f"*/{MARK}")))
    assert statuses(folder)["done"] == done < 10
    finished(batch(photos, folder, env=env), 0)
    assert Counter(noted(log, "end")) == {f"{k}.png": 1 for k in range(10)}


def test_a_photo_that_kills_its_worker(photos: Path, tmp_path: Path) -> None:
    """It is given up after two processes; the others are done."""
    log, folder = tmp_path / "log", tmp_path / "out"
    picture(photos / "killer.png", (0, 255, 0))
    run = batch(photos, folder, env=stand_in(log, 0.1))
    _, err = finished(run, 1)
    assert "killer.png: 2 worker processes died of it" in err
    assert statuses(folder) == {"done": 10, "failed": 1}
    assert Counter(photo for photo, _ in begun_by(log))["killer.png"] == 2


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_forty_real_photos(tmp_path: Path) -> None:
    """Few iterations at 256 pixels, two workers, one killed: forty results, none twice.

    What the batch adds to the work itself is at most 5 %: the workers' time from the first photo
    to the last, less what their photos took. (The killed worker's time ends with it.)
    """
    photos = tmp_path / "photos"
    photos.mkdir()
    face = astronaut()[:300, 100:350]
    for k in range(40):
        shown = np.clip(face * (0.8 + 0.01 * k), 0, 255).astype(np.uint8)
        Image.fromarray(shown).save(photos / f"{k}.png")
    quick = [f"--set=stage{k}.iterations={n}" for k, n in enumerate((20, 20, 10, 10, 10), 1)]
    folder, last = tmp_path / "out", 0.0
    with dask(tmp_path, 2, {}) as (address, processes):
        run = batch(photos, folder, "--preset", "draft", *quick, "--scheduler", address)
        began = time.time()
        until(lambda: len(list(folder.glob(f"*/{MARK}"))) >= 10, "ten results", 3600)
        kill(processes[1])
        killed = time.time()
        _, err = run.communicate(timeout=3 * 3600)
        last = time.time()
    assert run.returncode == 0, err
    assert statuses(folder) == {"done": 40}
    with (folder / "batch.csv").open() as file:
        work = sum(float(line["seconds"]) for line in csv.DictReader(file))
    available = (killed - began) + (last - began)
    print(
        f"work {work:.1f} s, workers' time {available:.1f} s, overhead {available / work - 1:.2%}"
    )
    assert available < 1.05 * work
