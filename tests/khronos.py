"""Khronos' validator of glTF files, where it is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

VALIDATE = """
const validator = require('gltf-validator');
const bytes = require('fs').readFileSync(process.argv[1]);
validator.validateBytes(new Uint8Array(bytes)).then(r => console.log(JSON.stringify(r.issues)));
"""


def issues_of(file: Path) -> list[int]:
    """Errors, warnings, infos and hints of Khronos' validator; skips where it is not installed."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    found = subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True)
    if found.returncode:
        pytest.skip("npm install gltf-validator, here or in NODE_PATH")
    done = subprocess.run([node, "-e", VALIDATE, str(file)], capture_output=True, check=True)
    issues = json.loads(done.stdout)
    print(issues["messages"])
    return [issues[f"num{kind}"] for kind in ("Errors", "Warnings", "Infos", "Hints")]
