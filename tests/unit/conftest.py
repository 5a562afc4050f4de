"""The default head model, where its data can be had, and a folder for others."""

from pathlib import Path

import pytest

from unlit.errors import ModelError
from unlit.head import files
from unlit.head.model import HeadModel
from unlit.head.sources import library
from unlit.head.sources.library import default_model


@pytest.fixture(scope="session")
def head() -> HeadModel:
    """The default model; skips where its data are neither cached nor to be fetched."""
    try:
        return default_model()
    except ModelError as error:
        pytest.skip(str(error))


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's own folder of head models is in it, not there yet: none has been added."""
    for module in (files, library):
        monkeypatch.setattr(module, "models_folder", lambda: tmp_path / "heads")
    monkeypatch.delenv("UNLIT_MODELS", raising=False)
    return tmp_path
