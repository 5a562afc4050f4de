"""Fixtures for every test."""

from pathlib import Path

import pytest

import unlit  # noqa: F401  (first: it decides which LLVM drjit loads)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of licensed photos, lights and scans beside a checkout; skips where absent."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not (folder / "data").is_dir():
        pytest.skip("the shared test data is not on this machine")
    return folder
