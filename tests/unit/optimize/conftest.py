"""Import the package before Dr.Jit, which looks for LLVM when it is loaded."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

import unlit  # noqa: F401


@pytest.fixture(scope="session")
def gradients() -> ModuleType:
    """The benchmark of the gradients, which the unit test runs on a smaller head."""
    path = Path(__file__).resolve().parents[3] / "benchmarks/gradients.py"
    spec = importlib.util.spec_from_file_location("benchmark_gradients", path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look for it
    spec.loader.exec_module(module)
    return module
