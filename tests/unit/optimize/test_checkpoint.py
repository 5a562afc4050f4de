"""A run that was broken off goes on to the same bits, and never with another run's state."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tiny_run
from changed import changed
from unlit.errors import OutputError
from unlit.face.reconstruction import Reconstruction
from unlit.optimize.checkpoint import Checkpoint
from unlit.output.arrays import write_arrays
from unlit.pipeline import identity
from unlit.settings.settings import Settings


def same(a: Reconstruction, b: Reconstruction, tmp_path: Path) -> bool:
    """All arrays alike to the bit, and the losses."""
    for name, face in (("a.npz", a), ("b.npz", b)):
        write_arrays(face, tmp_path / name)
    files = [(tmp_path / name).read_bytes() for name in ("a.npz", "b.npz")]
    return files[0] == files[1] and a.metrics.losses == b.metrics.losses


@pytest.fixture(scope="module")
def whole() -> Reconstruction:
    """A run that nothing interrupts and that keeps nothing."""
    return tiny_run.run()


def broken_off(folder: Path, chosen: Settings | None = None) -> Reconstruction:
    """The result of a run, with its state after each stage in FOLDER/stage1.npz and so on."""
    keep = Checkpoint.keep

    def keep_all(self, name, *rest):
        keep(self, name, *rest)
        shutil.copy(self.path, folder / f"{name}.npz")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Checkpoint, "keep", keep_all)
        return tiny_run.run(Checkpoint(folder / "state.npz"), chosen)


@pytest.fixture(scope="module")
def states(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("states")
    broken_off(folder)
    return folder


@pytest.fixture
def stopped(states, tmp_path):
    """Gives the file that a run has left which was broken off after a stage."""
    return lambda stage: Path(shutil.copy(states / f"{stage}.npz", tmp_path / "state.npz"))


@pytest.mark.parametrize("stage", ["stage1", "stage2", "stage3", "stage4", "stage5"])
def test_resumed_is_the_same_to_the_bit(whole, stopped, tmp_path, stage):
    """Maps, mesh, light, render and the history of the losses, from the end of every stage."""
    state = Checkpoint(stopped(stage), resume=True)
    assert state.stage == int(stage[-1])
    assert same(tiny_run.run(state), whole, tmp_path)


def test_a_stage_that_was_switched_off(tmp_path):
    """Without stage 5 the exposure depends on the normals with which stage 4 has ended."""
    chosen = tiny_run.settings()
    off = replace(chosen, stage5=replace(chosen.stage5, iterations=0))
    expected = broken_off(tmp_path, off)
    state = Checkpoint(tmp_path / "stage4.npz", resume=True)
    assert same(tiny_run.run(state, off), expected, tmp_path)


def test_previews_do_not_change_the_result(whole, tmp_path):
    """They shade with the final normals; the stages must not go on with those."""
    shown = []
    face = tiny_run.run(preview=lambda *a: shown.append(a))
    assert [name for name, _ in shown] == ["fit", *(f"stage{k}" for k in range(1, 6))]
    assert not shown[0][1].images.render.any()
    assert shown[1][1].images.render.any()
    assert same(face, whole, tmp_path)


def test_killed_and_killed_again(tmp_path):
    """kill -9 a moment after the first stage, then after the third: as if never interrupted."""
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    for folder in (whole, broken):
        folder.mkdir()
    program = [sys.executable, tiny_run.__file__]
    for stage in (1, 3):
        process = subprocess.Popen([*program, broken, "--resume"])
        while process.poll() is None:
            if Checkpoint(broken / "state.npz", resume=True).stage >= stage:
                time.sleep(random.uniform(0, 0.1))
                process.kill()
                break
            time.sleep(0.01)
        assert process.wait() == -signal.SIGKILL
    for folder in (whole, broken):
        subprocess.run([*program, folder, "--resume"], check=True)
    files = [(folder / "done.npz").read_bytes() for folder in (whole, broken)]
    assert files[0] == files[1]


def test_nothing_to_resume_is_a_start(tmp_path):
    """Broken off before the first stage was done, or never begun."""
    assert Checkpoint(tmp_path / "state.npz", resume=True).stage == 0


class Stop(Exception):
    """Stands for Ctrl-C."""


def test_without_resume_it_is_discarded(stopped, monkeypatch):
    """Once the photo has been read and a face been found in it."""

    def stop(*_: object) -> None:
        raise Stop

    path = stopped("stage2")
    state = Checkpoint(path)
    assert state.stage == 0
    assert path.exists()
    monkeypatch.setattr("unlit.optimize.solve.run_stages", stop)
    with pytest.raises(Stop):
        tiny_run.run(state)
    assert not path.exists()


def test_another_run_is_refused_and_named(stopped, monkeypatch):
    """One line that says what differs; the file stays for the run it belongs to."""
    path = stopped("stage1")

    def refused(**options) -> str:
        with pytest.raises(OutputError) as caught:
            tiny_run.run(Checkpoint(path, resume=True), **options)
        assert path.exists()
        assert "\n" not in str(caught.value)
        assert "start anew" in str(caught.value)
        return str(caught.value)

    assert "another photo (tiny.png, not b.png)" in refused(name="b.png")
    more = tiny_run.settings(clip=0.5, bounces=2)
    assert "other settings (bounces 3, not 2, clip 1.0, not 0.5)" in refused(chosen=more)
    with monkeypatch.context() as patch:
        patch.setattr(identity, "version", lambda _: "9.9")
        assert "another version of unlit" in refused()
    with monkeypatch.context() as patch:
        patch.setattr(identity, "code", lambda _: "changed")
        assert "another version of unlit (other code)" in refused()
    head = tiny_run.head()
    moved = changed(head, {"mesh.vertices": head.mesh.vertices + np.float32(0.01)})
    assert "another face or head" in refused(known=tiny_run.steps(fitted=moved))


def rewrite(path: Path, name: str, array: np.ndarray | bytes) -> None:
    """Replace one member of the file."""
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for member, data in members.items():
            if member != f"{name}.npy":
                archive.writestr(member, data)
        with archive.open(f"{name}.npy", "w") as file:
            if isinstance(array, bytes):
                file.write(array)
            else:
                np.lib.format.write_array(file, array, allow_pickle=True)


class Bomb:
    """Ends the test run if it is ever unpickled."""

    def __reduce__(self):
        return (pytest.exit, ("a pickle was loaded",))


def text(values: object) -> np.ndarray:
    return np.frombuffer(json.dumps(values).encode(), np.uint8)


#: A table with all its fields, but an iteration that no integer holds.
ENDLESS = {
    "stage": 1,
    "identity": vars(tiny_run.identity("")),
    "observation": "",
    "losses": {"stage1": [[float("inf"), 0.0]]},
    "seconds": {},
}


@pytest.mark.parametrize(
    ("name", "array", "said"),
    [
        ("about", np.array(Bomb(), dtype=object), "about has type object"),
        ("about", text([1]), "about is damaged"),
        ("about", text({"stage": 9}), "about is damaged"),
        ("about", np.frombuffer(b"{", np.uint8), "about is damaged"),
        ("about", text(ENDLESS), "about is damaged"),
        ("about", text([]).repeat(1 << 24), "about has shape"),
        ("axis", np.array(Bomb(), dtype=object), "axis has type object"),
        ("log_specular", np.zeros(3, "f4"), "log_specular has shape"),
        ("vertices", np.zeros((3, 3), "f4"), "vertices has shape"),
        ("vertices", b"\x93NUMPY junk", "vertices is damaged"),
        ("triangle", None, "triangle points outside"),
    ],
)
def test_a_broken_file_is_refused(stopped, name, array, said):
    """It may be anybody's: nothing is unpickled, sizes are bounded, indices checked."""
    path = stopped("stage3")
    if array is None:
        with np.load(path) as found:
            array = np.full_like(found["triangle"], 1 << 30)
    rewrite(path, name, array)
    with pytest.raises(OutputError, match=r"state\.npz: ") as caught:
        tiny_run.run(Checkpoint(path, resume=True))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_cut_off(stopped):
    """As after a power cut."""
    path = stopped("stage1")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(OutputError, match=r"damaged or cut off .* start anew"):
        Checkpoint(path, resume=True)
