"""The command line: its help, its errors of one line, its exit codes, and no trace of failure."""

import os
import signal
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import unlit
from unlit import cli
from unlit.cli import settings
from unlit.errors import FaceError, ModelError, SettingsError
from unlit.face.reconstruction import Metrics
from unlit.settings import settings as schedule

COMMANDS = ("reconstruct", "demo", "evaluate", "montage", "models", "cite", "doctor")


@pytest.fixture
def photo(tmp_path) -> Path:
    path = tmp_path / "portrait.png"
    Image.fromarray(np.full((80, 90, 3), 128, np.uint8)).save(path)
    return path


class Pipeline(types.ModuleType):
    """Stands for pipeline.chain; `run` is what `reconstruct` does, `calls` what it was given."""

    def __init__(self) -> None:
        super().__init__("unlit.pipeline.chain")
        self.calls: list[Any] = []
        self.run: Any = lambda options: None

    def reconstruct(self, photo: Any, **options: Any) -> Any:
        self.calls.append((photo, options))
        return self.run(options)


@pytest.fixture
def pipeline(monkeypatch):
    """The chain replaced, and no models fetched."""
    fake = Pipeline()
    monkeypatch.setitem(sys.modules, "unlit.pipeline.chain", fake)
    monkeypatch.setattr(unlit, "pipeline", fake, raising=False)
    monkeypatch.setattr(cli.models, "fetch", lambda *commands: None)
    return fake


def run(capsys, *arguments: str) -> tuple[Any, str, str]:
    """Exit code, standard output and standard error of a command in this process."""
    try:
        code = cli.main(arguments)
    except SystemExit as error:
        code = error.code
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return (code, *capsys.readouterr())


def processor_seconds(*code: str) -> float:
    """What Python takes of the processor to run `code`, at the best of three times."""
    found = []
    for _ in range(3):
        before = os.times()
        subprocess.run([sys.executable, "-c", "\n".join(code)], check=True, capture_output=True)
        after = os.times()
        found.append(after[2] + after[3] - before[2] - before[3])  # children's
    return min(found)


def test_help_is_quick_and_does_not_load_the_renderer():
    """`unlit --help` must answer at once: nothing heavy may be imported for it."""
    taken = processor_seconds(
        "import sys, unlit.cli",
        "try: unlit.cli.main(['--help'])",
        "except SystemExit: pass",
        "heavy = {'mitsuba', 'drjit', 'numpy', 'cv2', 'PIL', 'rich', 'scipy'} & set(sys.modules)",
        "assert not heavy, heavy",
    )
    assert taken < 0.25
    assert processor_seconds("import unlit") < 0.1


@pytest.mark.parametrize("command", COMMANDS)
def test_every_help_teaches_by_example(capsys, command):
    """The example is a line that can be typed."""
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert f"unlit {command}" in out.split("example")[1]


def test_version(capsys):
    """As in the package's metadata."""
    assert run(capsys, "--version")[:2] == (0, f"unlit {unlit.__version__}\n")


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("reconstruct", "a.jpg"),
        ("reconstruct", "a.jpg", "-o", "b", "--set", "x"),
        ("nonsense",),
    ],
)
def test_wrong_usage_is_2(capsys, arguments):
    """As is usual."""
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.splitlines()[-1].startswith("unlit")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("relight a --light flash --light uniform -o b.png", "--light: given twice; give it once"),
        ("relight a --light flash -o b.png --fast --fast", "--fast: given twice"),
        ("relight a --light flash -o b.png --output c.png", "-o/--output: given twice"),
        ("batch a -o b --face 1 --face=2", "--face: given twice"),
        ("reconstruct a -o b --resume --resume", "--resume: given twice"),
        ("reconstruct a -o b --resolutoin 512", "--resolutoin: did you mean --resolution?"),
        ("reconstruct a -o b --resolutoin=512", "--resolutoin=512; --resolutoin: did you mean"),
        ("relight a --lihgt flash -o b", "--lihgt: did you mean --light?"),
        ("export a --driectx", "did you mean --directx?"),
        ("reconstrct a", "reconstrct: did you mean reconstruct?"),
        ("--verison", "did you mean --version?"),
    ],
)
def test_what_argparse_would_pass_over(capsys, line, said):
    """Of an option given twice the last would count; of a misspelt one nothing would be said."""
    code, out, err = run(capsys, *line.split())
    assert (code, out) == (2, "")
    assert said in err.splitlines()[-1]


def test_options_that_may_be_given_twice_or_in_short():
    """--set repeats; a beginning that is clear is enough; a value may be like an option's."""
    line = "reconstruct a -o b --set clip=2 --set bounces=1 --resol 300 --face 0"
    options = cli._parser().parse_args(line.split())
    assert options.set == [("clip", "2"), ("bounces", "1")]
    assert (options.resolution, options.face) == (300, 0)


@pytest.mark.parametrize(
    ("line", "name", "wanted"),
    [
        ("reconstruct ~/x.jpg -o=~/b --mask ~/m.png", "photo", "x.jpg"),
        ("reconstruct a -o=~/b", "output", "b"),
        ("reconstruct a --resume=~/b", "resume", "b"),
        ("reconstruct a --config=~/c.toml", "config", "c.toml"),
        ("reconstruct a --model ~/h.npz", "model", "h.npz"),
        ("relight ~/r --light ~/l.hdr -o b", "light", "l.hdr"),
        ("montage ~/r", "folder", "r"),
    ],
)
def test_the_home_in_quotes(monkeypatch, tmp_path, line, name, wanted):
    """The shell expands no ~ in quotes, nor after "="."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    found = getattr(cli._parser().parse_args(line.replace("-o=", "--output=").split()), name)
    assert Path(found) == tmp_path / wanted


def test_settings_in_order_of_precedence(photo, pipeline, tmp_path, capsys, monkeypatch):
    """Preset, then --config, then --resolution, then --set."""
    monkeypatch.setattr("unlit.output.save.save", lambda *_: None)
    made = types.SimpleNamespace(
        head=types.SimpleNamespace(landmark_residual=None),
        photo=types.SimpleNamespace(white_luminance=None),
        metrics=Metrics({}, {}, 0.0),
    )
    pipeline.run = lambda options: made
    config = tmp_path / "c.toml"
    config.write_text("resolution = 300\nbounces = 1\nclip = 2.0\n[stage2]\niterations = 7\n")
    arguments = ("--preset", "draft", "--config", str(config), "--resolution", "400")
    arguments += ("--set", "clip=3", "--set", "stage2.rate=0.5", "--face", "1")
    assert run(capsys, "reconstruct", str(photo), "-o", str(tmp_path / "out"), *arguments)[0] == 0
    _, options = pipeline.calls[0]
    settings = options["settings"]
    assert (settings.resolution, settings.bounces, settings.clip) == (400, 1, 3.0)
    assert (settings.stage2.iterations, settings.stage2.rate) == (7, 0.5)
    assert settings.stage1 == schedule.PRESETS["draft"].stage1
    assert options["face"] == 1


def test_config_may_be_an_older_result(photo, tmp_path):
    """`--config DIR/reconstruction.toml` repeats a run."""
    path = tmp_path / "reconstruction.toml"
    path.write_text('photo = "x"\n[settings]\nbounces = 1\n')
    options = cli._parser().parse_args(["reconstruct", "a", "-o", "b", "--config", str(path)])
    assert settings.settings_of(options).bounces == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# x\nrate_hld = 0.5\n", ", line 2: rate_hld: no such setting; did you mean rate_hold?"),
        ("[settings]\n\nrate_hld = 0.5", ", line 3: rate_hld: no such setting"),
        ("photo = 'a'\nrate_hld = 0.5\n[settings]", ", line 2: rate_hld: settings stand below"),
        ("[stage2]\nrate = -1", ", line 2: stage2.rate=-1: expected float, 0 or more, at most"),
        ("stage2.rate = -1", ", line 1: stage2.rate=-1"),
        ("stage2 = {rate = -1}", ", line 1: stage2.rate=-1"),
        ("[landmark_fit]\ndim = [\n 0.4, 0.3]", ", line 2: landmark_fit.dim: the second"),
        ("light_color = 'warm'", ", line 1: light_color='warm': write"),
    ],
)
def test_mistakes_in_a_settings_file_are_found_by_line(tmp_path, text, said):
    """File, line, name, and what may stand there; nothing is passed over."""
    path = tmp_path / "c.toml"
    path.write_text(text)
    options = cli._parser().parse_args(["reconstruct", "a", "-o", "b", "--config", str(path)])
    with pytest.raises(SettingsError) as error:
        settings.settings_of(options)
    assert str(error.value).startswith(f"{path}{said}")


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--set", "foo=1"), 2, "foo: no such setting"),
        (("--resolution", "7"), 2, "resolution=7"),
        (("--config", "no.toml"), 2, "no.toml: cannot be read"),
        (("--set", "clip=2", "--set", "clip=3"), 2, "--set clip: given twice"),
    ],
)
def test_bad_settings_are_2_and_one_line(photo, pipeline, tmp_path, capsys, arguments, code, said):
    """Before anything is written."""
    folder = tmp_path / "out"
    found, out, err = run(capsys, "reconstruct", str(photo), "-o", str(folder), *arguments)
    assert (found, out) == (code, "")
    assert err.startswith(f"unlit: error: {said}")
    assert err.count("\n") == 1
    assert not folder.exists()


def raiser(error: BaseException):
    def raise_(*_):
        raise error

    return raise_


def wrapped(error: BaseException) -> RuntimeError:
    """As Dr.Jit passes on what was raised inside a custom operation."""
    outer = RuntimeError("drjit.custom(...): error while performing a custom operation")
    outer.__cause__ = error
    return outer


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (FaceError("a.png: no\nface found"), 1, "unlit: error: a.png: no face found"),
        (KeyboardInterrupt(), 130, "unlit: interrupted"),
        (wrapped(KeyboardInterrupt()), 130, "unlit: interrupted"),
        (SystemExit(143), 143, "unlit: asked to end"),
        (wrapped(SystemExit(143)), 143, "unlit: asked to end"),
        (wrapped(wrapped(FaceError("x"))), 1, "unlit: error: x"),
        (MemoryError(), 1, "unlit: error: not enough memory"),
        (RuntimeError("jit_malloc(): out of memory!"), 1, "unlit: error: not enough memory"),
        (PermissionError(13, "no", "a"), 1, "unlit: error: a: no permission"),
    ],
)
def test_a_failed_run_is_one_line_and_leaves_no_trace(
    photo, pipeline, tmp_path, capsys, error, code, said
):
    """Whatever ends it: the folders made for it and the preview are gone, the code is not 0."""
    folder = tmp_path / "deep" / "out"

    def fail(options):
        assert folder.is_dir()
        (folder / "unlit-preview.png").write_bytes(b"png")
        raise error

    pipeline.run = fail
    found, out, err = run(capsys, "reconstruct", str(photo), "-o", str(folder))
    assert (found, out) == (code, "")
    assert err.splitlines()[-1].startswith(said)
    assert sum(line.startswith("unlit: ") for line in err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == [photo.name]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_an_import_is_not_lost(tmp_path, number):
    """Extension modules swallow what a handler raises while they are loaded, or crash on it."""
    (tmp_path / "swallows.py").write_text(
        "import signal, sys\n"
        "try: signal.raise_signal(int(sys.argv[1]))\n"
        "except BaseException: pass\n"
        "print('loaded', flush=True)\n"
    )
    code = (
        "import sys, time\n"
        "from unlit import cli\n"
        "def run(options):\n"
        "    import swallows\n"
        "    time.sleep(60)\n"
        "    return 0\n"
        "cli.doctor.run = run\n"
        "sys.exit(cli.main(['doctor']))\n"
    )
    command = [sys.executable, "-c", code, str(int(number))]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=50
    )
    assert (done.returncode, done.stdout) == (128 + number, "loaded\n")
    assert len(done.stderr.splitlines()) == 1
    assert "nothing half-written is left" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("a.jpg", "-o", "b"), "run it again with --resume to go on"),
        (("--resume", "b", "--from-stage", "4"), "the saved result is as it was; run the same"),
    ],
)
def test_an_interrupted_run_says_how_to_go_on(capsys, monkeypatch, arguments, said):
    """A run from a saved result keeps no state of its own: --resume alone would be refused."""
    for name in ("reconstruct_into", "_continue"):
        monkeypatch.setattr(cli.reconstruct, name, raiser(KeyboardInterrupt()))
    code, _, err = run(capsys, "reconstruct", *arguments)
    assert code == 130
    assert said in err


def test_values_may_begin_like_negative_numbers():
    """What takes them says what is wrong with them, if anything; options are still told apart."""
    options = cli._parser().parse_args(["relight", "a", "--light", "-30,10", "-o", "b.png"])
    assert (options.light, options.output) == ("-30,10", "b.png")
    options = cli._parser().parse_args(["reconstruct", "a", "-o", "b", "--light-color", "-.5,1"])
    assert (options.light_color, options.output) == ("-.5,1", "b")


def test_a_bug_is_not_hidden(photo, pipeline, tmp_path, capsys):
    """An error that no user can mend keeps its traceback; the folder is cleaned all the same."""
    pipeline.run = raiser(ZeroDivisionError())
    with pytest.raises(ZeroDivisionError):
        run(capsys, "reconstruct", str(photo), "-o", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("no.jpg", None, "no such file"),
        ("text.jpg", b"text", "not a picture"),
        ("e.jpg", b"", "empty"),
    ],
)
def test_a_bad_photo_costs_no_time(pipeline, tmp_path, capsys, name, content, said):
    """Read before models are fetched or anything is computed; the error names it."""
    if content is not None:
        (tmp_path / name).write_bytes(content)
    folder = tmp_path / "out"
    code, _, err = run(capsys, "reconstruct", str(tmp_path / name), "-o", str(folder))
    assert code == 1
    assert name in err
    assert said in err
    assert not pipeline.calls
    assert not folder.exists()


def test_a_folder_that_cannot_be_written_is_refused_first(photo, pipeline, tmp_path, capsys):
    """Not after minutes."""
    code, _, err = run(capsys, "reconstruct", str(photo), "-o", str(photo / "out"))
    assert code == 1
    assert "not a folder" in err
    assert not pipeline.calls


def test_missing_models_are_one_line(photo, tmp_path, capsys, monkeypatch):
    """Offline on the first run."""
    monkeypatch.setattr(cli.models, "fetch", raiser(ModelError("face.task: offline; do this")))
    code, _, err = run(capsys, "reconstruct", str(photo), "-o", str(tmp_path / "out"))
    assert (code, err) == (1, "unlit: error: face.task: offline; do this\n")


def test_models_and_doctor_tell_by_their_code(capsys, monkeypatch):
    """`verify` and `doctor` can be used in scripts; `list` only tells."""
    from unlit.machine import assets, doctor

    entry = next(iter(assets.ASSETS.values()))
    monkeypatch.setattr(
        assets, "statuses", lambda: [assets.AssetStatus(entry, None, "is not here")]
    )
    for action, expected in (("list", 0), ("verify", 1), ("licences", 0)):
        code, out, _ = run(capsys, "models", action)
        assert code == expected
        assert entry.licence in out
        assert ("is not here" in out) == (action != "licences")
    for ok in (True, False):
        checks = [doctor.Check("thing", ok, "found", "" if ok else "mend it")]
        monkeypatch.setattr(doctor, "checks", lambda checks=checks: checks)
        code, out, _ = run(capsys, "doctor")
        assert code == (0 if ok else 1)
        assert ("mend it" in out) != ok


def test_cite_prints_each_work_in_words_or_as_bibtex(capsys):
    code, out, _ = run(capsys, "cite")
    assert code == 0
    assert "Mitsuba 3" in out and "@" not in out
    code, out, _ = run(capsys, "cite", "--bibtex")
    assert code == 0
    assert out.count("@") > 8 and "@software{unlit," in out


@pytest.mark.parametrize(
    ("command", "path", "code"),
    [
        ("reconstruct", None, 1),
        ("reconstruct", Path("damaged"), 1),
        ("evaluate", None, 0),
        ("evaluate", Path("damaged"), 1),
    ],
)
def test_a_missing_model_fails_verify_only_if_needed(capsys, monkeypatch, command, path, code):
    """LPIPS's weights are fetched when `evaluate` wants them; a damaged file is always told."""
    from unlit.machine import assets

    entry = next(x for x in assets.ASSETS.values() if x.command == command)
    status = assets.AssetStatus(entry, path, "is bad")
    monkeypatch.setattr(assets, "statuses", lambda: [status])
    found, out, _ = run(capsys, "models", "verify")
    assert found == code
    assert "is bad" in out
    assert ("only `unlit evaluate` needs it" in out) == (command == "evaluate")


@pytest.mark.parametrize("target", ["pipe", "/dev/full"])
def test_nobody_reads_the_output(target):
    """`unlit models | head -0` and a full disk behind standard output: no traceback at exit."""
    if target == "pipe":
        reader, writer = os.pipe()
        os.close(reader)
    elif not Path(target).exists():
        pytest.skip("no /dev/full here")
    else:
        writer = os.open(target, os.O_WRONLY)
    command = [sys.executable, "-m", "unlit", "models", "licences"]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert done.returncode == (141 if target == "pipe" else 1)
    assert len(done.stderr.splitlines()) == (0 if target == "pipe" else 1)


def test_the_public_names_exist_and_are_lazy():
    """`import unlit` loads nothing heavy, and every name it promises is there."""
    code = "import sys, unlit; assert not {'numpy', 'mitsuba'} & set(sys.modules); dir(unlit)"
    subprocess.run([sys.executable, "-c", code], check=True)
    for name in unlit.__all__:
        assert getattr(unlit, name) is not None
    assert unlit.lights.flash().shape == (180, 360)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = unlit.nonsense


def test_an_interrupted_run_names_the_preview_that_stays(capsys, monkeypatch, tmp_path):
    preview = tmp_path / "unlit-preview.png"

    def stop(read, options, *_):
        options.preview = preview
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.reconstruct, "reconstruct_into", stop)
    assert str(preview) not in run(capsys, "reconstruct", "a.jpg", "-o", "b")[2]
    preview.touch()
    assert f"{preview} shows how far it came" in run(capsys, "reconstruct", "a.jpg", "-o", "b")[2]


def test_a_package_that_cannot_be_loaded_is_one_line(capsys, monkeypatch):
    """The remedy is the doctor's to know; a mistake of our own is not hidden."""
    broken = ImportError("libGL.so.1: cannot open shared object file", name="cv2")
    monkeypatch.setattr(cli.reconstruct, "reconstruct_into", raiser(broken))
    code, _, err = run(capsys, "reconstruct", "a.jpg", "-o", "b")
    assert code == 1 and err.count("\n") == 1 and "libGL" in err and "unlit doctor" in err
    module = compile("raise AttributeError('no such thing')", "module.py", "exec")

    def loading(name: str) -> Any:
        return lambda *_: exec(module, {"__name__": name})

    monkeypatch.setattr(cli.reconstruct, "reconstruct_into", loading("scipy.sparse"))
    code, _, err = run(capsys, "reconstruct", "a.jpg", "-o", "b")
    assert code == 1 and "(AttributeError: no such thing): see `unlit doctor`" in err
    monkeypatch.setattr(cli.reconstruct, "reconstruct_into", loading("unlit.head"))
    with pytest.raises(AttributeError):
        run(capsys, "reconstruct", "a.jpg", "-o", "b")
    ours = ImportError("no such name", name="unlit.head")
    monkeypatch.setattr(cli.reconstruct, "reconstruct_into", raiser(ours))
    with pytest.raises(ImportError):
        run(capsys, "reconstruct", "a.jpg", "-o", "b")
