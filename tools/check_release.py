"""Whether what would be released is whole: `python tools/check_release.py [--released]`.

Builds wheel and source archive into dist/, looks into both, installs each in a bare environment,
imports it and runs `unlit doctor` and `unlit cite` there, and holds version, changelog and citation
against each other. --released also refuses a changelog that says "(not released)". Exit code 1, and
a line for each fault, if something is wrong. Needs `pip install build` and the network.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"

#: Below unlit/ in the wheel: what is no Python, and missing would be found by users only.
DATA = (
    "py.typed",
    "machine/manifest.toml",
    "machine/citations.toml",
    "head/landmark_error.npz",
    "head/sources/makehuman_landmarks.npz",
    "head/sources/makehuman_prior.npz",
    "head/sources/makehuman_displacement.npz",
    "perception/parser.onnx",
    "report/web/viewer.js",
)
#: In the source archive: what the wheel is built from.
SOURCES = (
    "pyproject.toml",
    "hatch_build.py",
    "README.md",
    "LICENSE",
    "NOTICE",
    "viewer/package.json",
)


def version_faults(root: Path = ROOT, released: bool = False) -> Iterator[str]:
    """What does not agree on the version."""
    version = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "version"
    ]
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\S+) \((.+)\)$", changelog, re.M)
    if newest is None or newest[1] != version:
        found = newest[1] if newest else "missing"
        yield f"CHANGELOG.md: the newest section is {found}, not {version}"
    elif released and not re.fullmatch(r"\d{4}-\d\d-\d\d", newest[2]):
        yield f"CHANGELOG.md: {version} has no date, but ({newest[2]})"
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    if f"\nversion: {version}\n" not in citation:
        yield f"CITATION.cff: not of version {version}"


def wheel_faults(wheel: Path) -> Iterator[str]:
    """What the wheel lacks, or should not have."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    yield from (f"{wheel.name}: no unlit/{name}" for name in DATA if f"unlit/{name}" not in names)
    licences = {Path(name).name for name in names if ".dist-info/licenses/" in name}
    yield from (
        f"{wheel.name}: no {name}" for name in ("LICENSE", "NOTICE") if name not in licences
    )
    strange = {
        name.split("/")[0] for name in names if not re.match(r"unlit(-[^/]+\.dist-info)?/", name)
    }
    yield from (f"{wheel.name}: also installs {name}" for name in sorted(strange))


def source_faults(source: Path) -> Iterator[str]:
    """What the source archive lacks."""
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    yield from (f"{source.name}: no {name}" for name in SOURCES if name not in names)


def installed_faults(file: Path) -> Iterator[str]:
    """What does not run once the file is installed with nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        python = Path(folder) / "bin" / "python"
        steps = (
            [sys.executable, "-m", "venv", folder],
            [str(python), "-m", "pip", "install", "--quiet", str(file)],
            [str(python), "-c", "import unlit; unlit.reconstruct; print(unlit.__version__)"],
            [str(python.with_name("unlit")), "cite", "--bibtex"],
            [str(python.with_name("unlit")), "doctor"],
        )
        for step in steps:
            # Outside the checkout, or its src/ could stand in for what is installed.
            done = subprocess.run(step, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                said = (done.stderr + done.stdout).strip().splitlines()[-3:]
                yield f"{file.name}: {' '.join(step[1:3])}: {' / '.join(said)}"
                return


def built() -> tuple[Path, Path]:
    """The wheel and the source archive, built anew."""
    for old in DIST.glob("unlit-*"):
        old.unlink()
    subprocess.run([sys.executable, "-m", "build", "--outdir", str(DIST), str(ROOT)], check=True)
    return next(DIST.glob("unlit-*.whl")), next(DIST.glob("unlit-*.tar.gz"))


def main() -> int:
    """Check all; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--released", action="store_true", help="the changelog has to have a date")
    released = parser.parse_args().released
    wheel, source = built()
    faults = [*version_faults(released=released), *wheel_faults(wheel), *source_faults(source)]
    for file in (wheel, source):
        print(f"installing {file.name} in a bare environment", flush=True)
        faults += installed_faults(file)
    for fault in faults:
        print(f"BAD  {fault}")
    if not faults:
        print(f"ok   {wheel.name}, {source.name}")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
