"""A whole batch with a stand-in for the reconstruction: what is done, what not, what twice."""

import csv
import importlib.util
import shutil
import sys
from pathlib import Path

import pytest
from fsspec.implementations.memory import MemoryFileSystem

import batch_stand_in
import unlit
from batch_stand_in import noted, picture
from unlit import cli
from unlit.batches import task
from unlit.batches.cluster import connected, workers_and_threads
from unlit.batches.folder import BatchFolder
from unlit.batches.photos import find_photos
from unlit.batches.run import BatchRequest, Counts, run_batch
from unlit.errors import MachineError
from unlit.head.sources import library
from unlit.pipeline import identity
from unlit.storage.folder import MARK

RED = (255, 0, 0)
DRAFT = unlit.PRESETS["draft"]


def batch(photos: Path, folder: str, settings=DRAFT, face="only", watch=None):
    """Rows of a batch, and how the counts were at its end."""
    last = []

    def keep(counts: Counts, rows) -> None:
        last[:] = [counts]
        if watch:
            watch(counts, rows)

    request = BatchRequest(find_photos([str(photos)]), folder, settings, face)
    return run_batch(request, keep), last[0]


@pytest.fixture
def photos(tmp_path) -> Path:
    for name in ("a/x.jpg", "b/x.jpg", "c.png"):
        picture(tmp_path / "photos" / name, (len(name), 50, 50))
    return tmp_path / "photos"


@pytest.mark.usefixtures("cluster")
class TestBatch:
    def test_every_photo_once(self, photos, tmp_path, log):
        """A result, a record and a row for each; a second call does nothing."""
        folder = tmp_path / "out"
        rows, counts = batch(photos, str(folder))
        assert [row.error for row in rows] == [""] * 3
        assert (counts.done, counts.failed, counts.before) == (3, 0, 0)
        assert sorted(noted(log, "end")) == ["c.png", "x.jpg", "x.jpg"]
        for row in rows:
            mark = (folder / row.folder / MARK).read_text()
            assert Path(row.photo).name in mark
        assert len({row.folder for row in rows}) == 3
        assert rows[0].losses == {"stage1": 0.5}
        assert rows[0].render_psnr == pytest.approx(37, abs=5)
        again, counts = batch(photos, str(folder))
        assert again == rows
        assert (counts.done, counts.before) == (0, 3)
        assert len(noted(log, "begin")) == 3
        table = list(csv.DictReader((folder / "batch.csv").open()))
        assert [line["photo"] for line in table] == [row.photo for row in rows]

    def test_a_report_that_was_written_later_is_found(self, photos, tmp_path, log):
        """The next call, which makes nothing, leads to it."""
        folder = tmp_path / "out"
        rows, _ = batch(photos, str(folder))
        (folder / rows[0].folder / "report.html").write_text("later")
        again, counts = batch(photos, str(folder))
        assert counts.before == 3
        assert [row.report for row in again] == [True, False, False]
        assert f'"{rows[0].folder}/report.html"' in (folder / "batch.html").read_text()

    def test_what_the_workers_are_at_is_told(self, photos, tmp_path, log, monkeypatch):
        """Step and share of each photo at hand, and of no other."""
        batch_stand_in.install(log, 3.0, patch=monkeypatch)
        heard = []
        batch(photos, str(tmp_path / "out"), watch=lambda counts, _: heard.extend(counts.working))
        assert {progress.step for progress in heard} == {"stage1"}
        assert {progress.place for progress in heard} <= {"x", "c"} | {p.job for p in heard}
        assert all(0 <= progress.share < 1 for progress in heard)

    def test_only_what_changed_is_done_again(self, photos, tmp_path, log):
        """Another photo under the name, other settings, and a result that was deleted."""
        folder = tmp_path / "out"
        rows, _ = batch(photos, str(folder))
        picture(photos / "c.png", (9, 9, 9))
        shutil.rmtree(folder / rows[1].folder)
        _, counts = batch(photos, str(folder))
        assert (counts.done, counts.before) == (2, 1)
        _, counts = batch(photos, str(folder), unlit.override(DRAFT, {"resolution": 300}))
        assert (counts.done, counts.before) == (3, 0)
        assert len(noted(log, "end")) == 8

    @pytest.mark.parametrize(
        ("change", "said"),
        [("code", "another version of unlit (other code)"), ("head", "another head model")],
    )
    def test_other_code_or_head_is_noticed(self, photos, tmp_path, log, monkeypatch, change, said):
        """All is made anew, and why is told; then nothing is."""
        folder = str(tmp_path / "out")
        batch(photos, folder)
        if change == "code":
            monkeypatch.setattr(identity, "code", lambda _: "changed")
        else:
            monkeypatch.setattr(library, "model_key", lambda _: "changed")
        _, counts = batch(photos, folder)
        assert (counts.done, counts.before, counts.anew) == (3, 0, {said: 3})
        _, counts = batch(photos, folder)
        assert (counts.done, counts.before, counts.anew) == (0, 3, {})

    def test_failing_photos_do_not_stop_the_others(self, photos, tmp_path, log):
        """No picture, a fault of ours: rows of one line with the reason; tried again next time."""
        (photos / "text.jpg").write_text("hello")
        picture(photos / "red.png", RED)
        rows, counts = batch(photos, str(tmp_path / "out"))
        assert (counts.done, counts.failed) == (3, 2)
        errors = {Path(row.photo).name: row.error for row in rows if row.error}
        assert "not a picture" in errors["text.jpg"]
        assert "ZeroDivisionError: no light" in errors["red.png"]
        assert not any("\n" in error for error in errors.values())
        picture(photos / "text.jpg")
        rows, counts = batch(photos, str(tmp_path / "out"))
        assert (counts.before, counts.done, counts.failed) == (3, 1, 1)

    def test_an_interrupted_batch_goes_on(self, photos, tmp_path, log):
        """Ctrl-C after the first photo: what is done is kept, summed up, and not done again."""
        folder = tmp_path / "out"

        def interrupt(counts: Counts, rows) -> None:
            if counts.done == 1:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            batch(photos, str(folder), watch=interrupt)
        done = len(noted(log, "end"))
        assert 1 <= done < 3
        _, counts = batch(photos, str(folder))
        assert counts.before == done
        assert len(noted(log, "end")) == 3

    def test_all_faces(self, photos, tmp_path, log, monkeypatch):
        """A folder for each face; a face that failed is done again without the others."""
        detected = []
        monkeypatch.setattr(
            "unlit.perception.landmarks.find_faces",
            lambda image: detected.append(1) or ["one", "other"],
        )
        rows, _ = batch(photos / "c.png", str(tmp_path / "out"), face="all")
        assert [row.folder for row in rows] == ["c/face0", "c/face1"]
        assert len(detected) == 1
        assert "c.png other" in (tmp_path / "out/c/face1" / MARK).read_text()
        shutil.rmtree(tmp_path / "out/c/face1")
        rows, _ = batch(photos / "c.png", str(tmp_path / "out"), face="all")
        assert [row.folder for row in rows] == ["c/face0", "c/face1"]
        assert len(noted(log, "end")) == 3

    def test_results_on_another_file_system(self, photos, log):
        """The same in a store without folders, on this machine's memory."""
        MemoryFileSystem.store.clear()
        rows, _ = batch(photos, "memory://bucket/out")
        fs = MemoryFileSystem()
        for row in rows:
            assert fs.exists(f"/bucket/out/{row.folder}/{MARK}")
        assert fs.exists("/bucket/out/batch.csv")
        _, counts = batch(photos, "memory://bucket/out")
        assert counts.before == 3

    def test_the_command(self, photos, tmp_path, log, capsys, monkeypatch):
        """Prints the summary's path, and each failure; exit code 1 if there was one."""
        monkeypatch.setattr(cli.batch.models, "fetch", lambda *_: None)
        command = ["batch", str(photos), "-o", str(tmp_path / "out"), "--preset", "draft"]
        assert cli.main(command) == 0
        printed = capsys.readouterr()
        assert printed.out.strip() == str(tmp_path / "out" / "batch.html")
        assert "3 of 3" in printed.err
        picture(photos / "re\x1bd.png", RED)
        assert cli.main(command) == 1
        printed = capsys.readouterr()
        assert "ZeroDivisionError" in printed.err
        assert "\x1b" not in printed.err


def test_a_task_that_is_run_again_does_nothing(photos, tmp_path, log):
    """Dask repeats a task whose worker died after it had ended; and it needs no Dask to run."""
    job = task.PhotoTask(str(photos / "c.png"), "c", str(tmp_path / "out"), {}, "only")
    assert task.run(job) == task.run(job)
    assert len(noted(log, "begin")) == 1
    assert "photo     c.png, 64 x 64" in (tmp_path / "out/c/run.log").read_text()


def test_without_a_measured_pixel_there_is_no_match(photos, tmp_path, log, monkeypatch):
    """The result is told with its warnings; a mean over nothing would be NaN."""
    chain = sys.modules["unlit.pipeline.chain"]
    whole = chain.reconstruct

    def hidden(*photo, **options):
        result = whole(*photo, **options)
        result.face.mask[:] = 0
        return result

    monkeypatch.setattr(chain, "reconstruct", hidden)
    job = task.PhotoTask(str(photos / "c.png"), "c", str(tmp_path / "out"), {}, "only")
    assert task.run(job)[0].render_psnr is None


def test_a_crash_between_result_and_record(photos, tmp_path, log, monkeypatch):
    """The result is there, its record not: the work is repeated, not lost."""
    job = task.PhotoTask(str(photos / "c.png"), "c", str(tmp_path / "out"), {}, "only")
    with monkeypatch.context() as patch:
        patch.setattr(BatchFolder, "write", lambda *_: (_ for _ in ()).throw(SystemExit))
        with pytest.raises(SystemExit):
            task.run(job)
    assert not task.run(job)[0].error
    assert len(noted(log, "end")) == 2


def test_somebody_elses_files_are_not_touched(photos, tmp_path, log):
    """A folder that was there before, of the result's name, with a file of a result's name."""
    (tmp_path / "out/c").mkdir(parents=True)
    (tmp_path / "out/c/montage.png").write_text("mine")
    job = task.PhotoTask(str(photos / "c.png"), "c", str(tmp_path / "out"), {}, "only")
    for _ in range(2):
        assert "holds montage.png" in task.run(job)[0].error
    assert (tmp_path / "out/c/montage.png").read_text() == "mine"


@pytest.mark.parametrize(
    ("cores", "memory", "jobs", "resolution", "expected"),
    [
        (2, 16e9, 40, 512, (2, 1)),
        (8, 64e9, 40, 512, (8, 1)),
        (8, 3.5e9, 40, 512, (3, 2)),
        (8, 64e9, 3, 512, (3, 2)),
        (2, 1e9, 40, 2048, (1, 2)),
        (1, 0.1e9, 1, 256, (1, 1)),
    ],
)
def test_workers_fit_cores_and_memory(cores, memory, jobs, resolution, expected):
    """One worker a core while memory lasts; else fewer, with more threads each."""
    assert workers_and_threads(cores, memory, jobs, resolution) == expected


def test_a_scheduler_that_is_not_there(monkeypatch):
    """One line that names the address and the remedy."""
    monkeypatch.setattr("unlit.batches.cluster._CONNECT_SECONDS", 1)
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        with pytest.raises(MachineError, match=r"no Dask scheduler.*dask scheduler") as error:  # noqa: SIM117
            with connected(address, 1, 256):
                pass
        assert address in str(error.value)
        assert "\n" not in str(error.value)


def test_a_missing_extra_is_named(monkeypatch, capsys):
    """One line that says what to install."""
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "distributed" else find(name)
    )
    assert cli.main(["batch", "photos", "-o", "out"]) == 1
    error = capsys.readouterr().err
    assert (
        error
        == "unlit: error: a batch needs distributed: install with `pip install 'unlit[batch]'`\n"
    )
