"""A real run killed at any moment and resumed: the same bits as one that was never interrupted."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage.data import astronaut

import unlit
from unlit.optimize.checkpoint import Checkpoint
from unlit.storage.folder import CHECKPOINT

#: Enough iterations that a kill falls into every stage, with the shape's rays traced anew.
QUICK = {1: 60, 2: 60, 3: 30, 4: 30, 5: 30}
#: More find rarer moments.
KILLS = int(os.environ.get("UNLIT_KILLS", "20"))


def command(photo: Path, folder: Path, *more: str) -> list[str]:
    settings = [word for k, n in QUICK.items() for word in ("--set", f"stage{k}.iterations={n}")]
    program = [sys.executable, "-m", "unlit", "reconstruct", str(photo), "-o", str(folder)]
    return [*program, "--preset", "draft", "--face", "largest", *settings, *more]


def run(*arguments: object) -> float:
    """Seconds that a command takes which must not fail."""
    begin = time.monotonic()
    done = subprocess.run([*map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return time.monotonic() - begin


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_killed_at_random_moments(tmp_path: Path) -> None:
    """kill -9 anywhere between the start of Python and the last file written, then --resume.

    Moments are spread over the parts of a run: before the end of stage 1, in each later stage,
    and while the result is written.
    """
    photo = tmp_path / "photo.png"
    Image.fromarray(astronaut()).save(photo)
    run(*command(photo, tmp_path / "first"))  # compiles the kernels
    duration = run(*command(photo, tmp_path / "whole"))
    expected = (tmp_path / "whole" / "reconstruction.npz").read_bytes()
    assert (tmp_path / "first" / "reconstruction.npz").read_bytes() == expected
    seconds = unlit.load(tmp_path / "whole").metrics.seconds
    parts = [seconds[f"stage{k}"] for k in range(1, 6)]
    parts = [duration - sum(parts[1:]) - 2, *parts[1:], 2.0]
    seed = random.randrange(1 << 32)
    print(f"seed {seed}")
    chance, kills = random.Random(seed), 0
    while kills < KILLS:
        folder = tmp_path / f"broken{kills}"
        stage = kills % len(parts)
        process = subprocess.Popen(
            command(photo, folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        state = folder / CHECKPOINT
        while process.poll() is None and Checkpoint(state, resume=True).stage < stage:
            time.sleep(0.02)
        time.sleep(chance.uniform(0, parts[stage]))
        if process.poll() is not None:  # it was faster than the first one
            continue
        process.kill()
        process.wait()
        run(*command(photo, folder, "--resume"))
        log = (folder / "reconstruction.log").read_text()
        print("killed;", next((x for x in log.splitlines() if x.startswith("resume")), "finished"))
        assert (folder / "reconstruction.npz").read_bytes() == expected
        assert not state.exists()
        shutil.rmtree(folder)
        kills += 1


@pytest.mark.long
def test_a_painted_mask_is_followed(tmp_path: Path) -> None:
    """Reconstruct, paint half of the mask black, go on from stage 2: no map in that half."""
    photo = tmp_path / "photo.png"
    Image.fromarray(astronaut()).save(photo)
    run(*command(photo, tmp_path / "result"))
    path = tmp_path / "result" / "mask.png"
    mask = np.array(Image.open(path))
    mask[:, :128] = 0
    Image.fromarray(mask).save(path)
    program = [sys.executable, "-m", "unlit", "reconstruct", "--resume", tmp_path / "result"]
    run(*program, "--from-stage", 2, "-o", tmp_path / "edited")
    again = np.array(Image.open(tmp_path / "edited" / "mask.png"))
    assert again[:, :128].max() == 0
    assert again[:, 128:].max() == 255
    assert "edited    mask.png" in (tmp_path / "edited" / "reconstruction.log").read_text()
