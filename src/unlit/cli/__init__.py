"""The command line: parses and prints, computes nothing.

Exit codes: 0 done; 1 an error in the input or on this machine; 2 wrong usage or settings; 130
interrupted by Ctrl-C; 143 asked to end. Every error a user can mend is one line on standard error.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from ..errors import SettingsError, UnlitError
from . import batch, cite, demo, doctor, evaluate, export, models, reconstruct, relight, show
from .answer import asked_for, print_object
from .arguments import Parser

#: In the order of the help.
COMMANDS = (reconstruct, batch, demo, evaluate, show, relight, export, models, cite, doctor)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    with contextlib.suppress(ValueError):  # not in the main thread
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) != signal.SIG_IGN:  # as for a script's background jobs
                signal.signal(number, _end)
    # Names of files need not be text: they are printed as the bytes that they are.
    if reconfigure := getattr(sys.stdout, "reconfigure", None):
        reconfigure(errors="surrogateescape")
    asked = asked_for(sys.argv[1:] if arguments is None else arguments)
    options = argparse.Namespace(again="", began=time.monotonic(), json=asked, preview="")
    try:
        _parser().parse_args(arguments, options)
        code = options.run(options)
        sys.stdout.flush()
        return code
    except (Exception, KeyboardInterrupt, SystemExit) as error:
        return _explain(_cause(error), options)


def _cause(error: BaseException) -> BaseException:
    """What went wrong: Dr.Jit wraps whatever is raised inside a custom operation, Ctrl-C too."""
    inner = error.__cause__ or error.__context__
    return _cause(inner) if type(error) is RuntimeError and inner is not None else error


def _explain(error: BaseException, options: argparse.Namespace) -> int:
    """Print one line about `error` and return the exit code; what is no user's doing is raised."""
    said = _said(error, options)
    if said is None:
        raise error
    line, code = said
    if line:
        print(f"unlit: {line}", file=sys.stderr)
        if options.json:
            print_object({"error": line.removeprefix("error: "), "code": code})
    return code


def _said(error: BaseException, options: argparse.Namespace) -> tuple[str, int] | None:
    """One line, perhaps empty, and the exit code; None for what is no user's doing."""
    match error:
        case UnlitError(argument=name):
            # The library names its arguments; options are spelt in another way.
            option = f" (option --{name.replace('_', '-')})" if name in vars(options) else ""
            return _failed(f"{error}{option}", 2 if isinstance(error, SettingsError) else 1)
        case KeyboardInterrupt():
            return _stopped("interrupted", options, 130)
        case SystemExit(code=143):
            return _stopped("asked to end", options, 143)
        case ImportError() if not (error.name or "").startswith("unlit"):
            return _failed(f"a package cannot be loaded ({error}): see `unlit doctor`", 1)
        case BrokenPipeError():
            _drop_output()
            return "", 141
        case MemoryError():
            return _failed(_MEMORY, 1)
        case RuntimeError() if "out of memory" in str(error):  # the renderer's own way to say it
            return _failed(_MEMORY, 1)
        case OSError(errno=errno.ENOSPC | errno.EDQUOT):
            _drop_output()
            return _failed(f"{error.filename or 'the disk'}: no space left; free some", 1)
        case PermissionError():
            return _failed(f"{error.filename or 'a file'}: no permission; change its rights", 1)
        case Exception() if _of_loading(error):
            reason = f"{type(error).__name__}: {error}"
            return _failed(f"a package cannot be loaded ({reason}): see `unlit doctor`", 1)
        case _:
            return None


def _of_loading(error: BaseException) -> bool:
    """Whether `error` was raised while a module that is none of ours was being loaded."""
    modules = (
        frame.f_globals.get("__name__", "")
        for frame, _ in traceback.walk_tb(error.__traceback__)
        if frame.f_code.co_name == "<module>"
    )
    return any(name.partition(".")[0] not in ("unlit", "__main__") for name in modules)


_LATER_SECONDS = 0.05
_MEMORY = "not enough memory: close programs, or use --preset draft or a lower --resolution"


def _failed(error: str, code: int) -> tuple[str, int]:
    return f"error: {' '.join(error.split())}", code


def _stopped(how: str, options: argparse.Namespace, code: int) -> tuple[str, int]:
    shown = options.preview and Path(options.preview).exists()
    kept = f"; {options.preview} shows how far it came" if shown else ""
    return f"{how}; nothing half-written is left{kept}{options.again}", code


def _drop_output() -> None:
    """Let go of what standard output still holds, so that it does not raise again at exit."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _end(number: int, frame: FrameType | None) -> None:
    """Raise what ends the command, but not in the middle of an import.

    There an extension module may swallow it, or crash on it; so the signal comes again later.
    """
    if _importing(frame):
        main_thread = threading.main_thread().ident
        later = threading.Timer(_LATER_SECONDS, signal.pthread_kill, (main_thread, number))
        later.daemon = True
        later.start()
    elif number == signal.SIGINT:
        raise KeyboardInterrupt
    else:
        raise SystemExit(128 + number)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        from importlib.metadata import version

        print(f"unlit {version('unlit')}")
        parser.exit()


def _parser() -> Parser:
    parser = Parser(
        prog="unlit",
        description="One photo of a face in; mesh, albedo, normals and light out.",
        epilog="example:\n  unlit reconstruct portrait.jpg -o portrait\n\n"
        "`unlit COMMAND --help` says more about a command.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in COMMANDS:
        module.add(commands)
    parser.commands = commands.choices
    return parser
