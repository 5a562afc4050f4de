"""Import the package before Dr.Jit, which looks for LLVM when it is loaded."""

import pytest

import unlit  # noqa: F401

# isort: split
from saved_head import Saved, saved_head


@pytest.fixture(scope="session")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Saved:
    """A small head as a saved result."""
    return saved_head(tmp_path_factory.mktemp("relighting"))
