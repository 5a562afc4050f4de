"""The default head model, where its data can be had."""

import pytest

from unlit.errors import ModelError
from unlit.head.model import HeadModel
from unlit.head.sources.library import default_model


@pytest.fixture(scope="session")
def head() -> HeadModel:
    """The default model; skips where its data are neither cached nor to be fetched."""
    try:
        return default_model()
    except ModelError as error:
        pytest.skip(str(error))
