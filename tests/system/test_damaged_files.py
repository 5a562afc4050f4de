"""Damaged copies of real files through the commands that read them: one line, or a right result."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from PIL import Image
from skimage.data import astronaut

import damaged_files
from small_head import save_quickly, small_head
from unlit.output.save import save

SCAN = "data/scans/lee_perry_smith"
SUBJECT = """\
format = 1
name = "scan"
units = "cm"
frontal = true
[[mesh]]
file = "LeePerrySmith.glb"
v_axis = "up"
diffuse_albedo = { file = "Map-COL.jpg", encoding = "srgb" }
"""


@pytest.fixture
def sources(tmp_path: Path, shared: Path) -> Path:
    """A JSON file of the files to damage: photos of all formats, a result, settings, a scan."""
    photos = tmp_path / "photos"
    photos.mkdir()
    result = tmp_path / "result"
    with pytest.MonkeyPatch.context() as patch:
        save_quickly(patch)
        save(small_head(32), result)
    kinds: dict[str, list[str | None]] = {}
    face = Image.fromarray(astronaut())
    for name, form in (("png", "PNG"), ("tif", "TIFF"), ("webp", "WEBP"), ("heic", "HEIF")):
        face.save(photos / f"face.{name}", form)
        kinds[f"photo {name}"] = [str(photos / f"face.{name}"), None]
    for photo in sorted((shared / "data/photos").glob("*.jpg")):
        kinds[f"photo {photo.stem}"] = [str(photo), None]
    for name in ("reconstruction.toml", "reconstruction.npz", "metrics.json"):
        kinds[f"result {name}"] = [str(result / name), str(result)]
    kinds["settings"] = [str(result / "reconstruction.toml"), None]
    subject = tmp_path / "subject"
    subject.mkdir()
    (subject / "subject.toml").write_text(SUBJECT)
    for path in (shared / SCAN).iterdir():
        if path.name in SUBJECT:
            (subject / path.name).write_bytes(path.read_bytes())
    for path in sorted(subject.iterdir()):
        kinds[f"subject {path.name}"] = [str(path), str(subject)]
    (tmp_path / "sources.json").write_text(json.dumps(kinds))
    return tmp_path / "sources.json"


@pytest.mark.parametrize(
    ("first", "last"), [(0, 20), pytest.param(20, 220, marks=pytest.mark.long)]
)
def test_damaged_files(sources: Path, tmp_path: Path, first: int, last: int) -> None:
    """No traceback, no crash, no minute without end, no file outside the output folder."""
    sandbox = tmp_path / "sandbox"
    sandbox.mkdir()
    done = subprocess.run(
        [sys.executable, damaged_files.__file__, str(sources), str(sandbox), str(first), str(last)],
        capture_output=True,
        text=True,
        check=False,
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == last - first, done.stderr
    for one in found:
        print({name: value for name, value in one.items() if name != "stray"})
        assert one["end"] == "exit", one
        assert one["code"] in (1, 2), one
        assert "Traceback" not in one["text"], one
        message = one["text"].splitlines()[-1]
        assert message.startswith("unlit: error: "), one
        assert len(message) < 600, one
        assert not one["stray"], one
    print(Counter(damaged_files.READ in one["text"] for one in found))
