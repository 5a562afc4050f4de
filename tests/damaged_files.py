"""Run commands on damaged copies of real files, each in a process of its own; print what came out.

    python damaged_files.py SOURCES SANDBOX FIRST LAST

SOURCES: JSON, name of a kind to [file to damage, folder it belongs to or null]. A line of JSON is
printed for each variant from FIRST to LAST. What comes after reading is a stand-in that says so.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import sys
import time
import traceback
import types
from pathlib import Path
from typing import Any

import numpy as np

import unlit
import unlit.photo.photo  # noqa: F401  (once for all variants)
from unlit import cli
from unlit.errors import UnlitError

#: Of the processor, and of the clock, for a machine that is busy with other things.
SECONDS, CLOCK_SECONDS = 60, 900
MEMORY = 6 << 30
READ = "stand-in: it was read"


def damage(content: bytes, others: list[bytes], random: np.random.Generator) -> tuple[str, bytes]:
    """One kind of damage, and the damaged content."""
    data = np.frombuffer(content, np.uint8).copy()
    kind = ("bits", "head bits", "cut", "type", "huge", "hole", "tail", "empty")[
        random.choice(8, p=[0.2, 0.2, 0.15, 0.12, 0.2, 0.06, 0.05, 0.02])
    ]
    if len(data) < 16:
        return kind, random.bytes(16)
    if kind in ("bits", "head bits"):
        size = min(len(data), 600) if kind == "head bits" else len(data)
        at = random.integers(0, size, int(2 ** random.uniform(0, 8)))
        data[at] ^= np.uint8(1) << random.integers(0, 8, len(at)).astype(np.uint8)
    elif kind == "cut":
        data = data[: random.integers(0, len(data))]
    elif kind == "type":
        return kind, others[random.integers(len(others))]
    elif kind == "huge":
        for at in random.integers(0, max(min(len(data) - 8, 400), 1), 3):
            data[at : at + 4] = 255 if random.random() < 0.5 else (0x7F, 0xFF, 0xFF, 0xFF)
    elif kind == "hole":
        start = random.integers(0, len(data))
        data[start : start + 5000] = 0
    elif kind == "tail":
        return kind, content + random.bytes(10_000)
    else:
        return kind, b""
    return kind, data.tobytes()


def arguments(kind: str, file: Path, out: Path) -> list[str]:
    """The command that reads `file`."""
    draft = ["--preset", "draft"]
    if kind.startswith("photo"):
        return ["reconstruct", str(file), "-o", str(out), *draft]
    if kind.startswith("settings"):
        photo = str(file.parent / "portrait.png")
        return ["reconstruct", photo, "-o", str(out), "--config", str(file)]
    if kind.startswith("result"):
        return ["export", str(file.parent), "-o", str(out), "--format", "ply"]
    return ["evaluate", str(file.parent / "subject.toml"), "-o", str(out), "--check", *draft]


def put_stand_ins(kind: str) -> None:
    def read(*_: Any, **__: Any) -> None:
        raise UnlitError(READ)

    cli.models.fetch = lambda *_: None
    pipeline = types.ModuleType("unlit.pipeline.chain")
    pipeline.reconstruct = read  # type: ignore[attr-defined]
    if not kind.startswith("subject"):
        sys.modules["unlit.pipeline.chain"] = pipeline
    if kind.startswith("result"):
        import unlit.output.export

        unlit.output.export.export = read  # type: ignore[assignment]
    if kind.startswith("subject"):
        from unlit.evaluate import command, subject_mesh

        def check(subject: Path, *_: Any) -> None:
            subject_mesh.read_subject(subject, 64)
            raise UnlitError(READ)

        command.run_check = check  # type: ignore[assignment]


def run(kind: str, command: list[str], log: Path) -> tuple[str, int]:
    """How the process ended: "exit" and its code, "signal" and its number, or "hang".

    Too much time of the processor is a signal, too.
    """
    child = os.fork()
    if child == 0:
        target = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(target, 1)
        os.dup2(target, 2)
        code = 99
        try:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            used = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
            resource.setrlimit(resource.RLIMIT_CPU, (used + SECONDS, used + SECONDS))
            put_stand_ins(kind)
            code = cli.main(command)
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else 99
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    end = time.monotonic() + CLOCK_SECONDS
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return ("exit", code) if code >= 0 else ("signal", -code)
        if time.monotonic() > end:
            os.kill(child, 9)
            os.waitpid(child, 0)
            return "hang", CLOCK_SECONDS
        time.sleep(0.005)


def tree(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def main(sources: str, sandbox: str, first: str, last: str) -> None:
    kinds = {name: tuple(pair) for name, pair in json.loads(Path(sources).read_text()).items()}
    others = [Path(file).read_bytes()[:1_000_000] for file, _ in kinds.values()]
    place = Path(sandbox)
    os.chdir(place)
    for number in range(int(first), int(last)):
        random = np.random.default_rng(number)
        kind = sorted(kinds)[number % len(kinds)]
        source, folder = kinds[kind]
        here = place / "in"
        if folder:
            shutil.copytree(folder, here)
        else:
            here.mkdir()
        file = here / Path(source).name
        shutil.copy(kinds["photo png"][0], here / "portrait.png")
        what, content = damage(Path(source).read_bytes(), others, random)
        file.unlink(missing_ok=True)
        file.write_bytes(content)
        out = place / "out"
        before = tree(place)
        end, code = run(kind, arguments(kind, file, out), place / "log")
        text = (place / "log").read_text(errors="replace")
        stray = sorted(
            path for path in tree(place) - before - {"log"} if path.split("/")[0] != "out"
        )
        result = {"number": number, "kind": kind, "damage": what, "end": end, "code": code}
        print(json.dumps({**result, "text": text[-2000:], "stray": stray}), flush=True)
        shutil.rmtree(here)
        shutil.rmtree(out, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
