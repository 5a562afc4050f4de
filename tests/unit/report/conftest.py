"""What the report's tests share."""

import pytest

from report_head import report_head
from unlit.face.reconstruction import Reconstruction
from unlit.output.atlas import Atlas, bake


@pytest.fixture(scope="session")
def face() -> Reconstruction:
    return report_head()


@pytest.fixture(scope="session")
def atlas(face: Reconstruction) -> Atlas:
    return bake(face, 64)
