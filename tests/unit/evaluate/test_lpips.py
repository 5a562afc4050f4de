"""LPIPS: the authors' figures, and what the reader of its weights refuses."""

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unlit.errors import ModelError
from unlit.evaluate.lpips import ASSET, lpips, read_arrays
from unlit.machine.assets import asset


@pytest.fixture
def weights() -> None:
    """The network's weights are there, or can be fetched; else the test is skipped."""
    try:
        asset(ASSET)
    except ModelError as error:
        pytest.skip(str(error))


@pytest.mark.usefixtures("weights")
def test_the_authors_example(shared: Path) -> None:
    """Their example pictures (64 x 64) have the distances their repository prints."""
    reference, blurred, warped = (
        np.asarray(Image.open(shared / f"data/lpips/ex_{name}.png").convert("RGB")) / 255.0
        for name in ("ref", "p0", "p1")
    )
    assert lpips(reference, blurred) == pytest.approx(0.722, abs=0.002)
    assert lpips(reference, warped) == pytest.approx(0.138, abs=0.002)
    assert lpips(reference, reference) == 0


@pytest.mark.usefixtures("weights")
def test_mask() -> None:
    """A difference far outside the mask does not count; over the whole picture it does."""
    rng = np.random.default_rng(0)
    picture = rng.uniform(0, 1, (256, 128, 3)).astype(np.float32)
    other = picture.copy()
    other[:40] = 1 - other[:40]
    below, above = np.zeros((256, 128), bool), np.zeros((256, 128), bool)
    below[192:], above[:32] = True, True
    whole = np.ones_like(below)
    plain = lpips(picture, other)
    assert lpips(picture, other, whole) == pytest.approx(plain, rel=1e-4)
    assert lpips(picture, other, below) < 0.02 * plain
    assert lpips(picture, other, above) > 2 * plain


def test_sizes() -> None:
    """Pictures that differ in size or are too small to pool are refused."""
    for a, b in (((64, 64, 3), (64, 65, 3)), ((20, 64, 3), (20, 64, 3)), ((64, 64), (64, 64))):
        with pytest.raises(ValueError, match="LPIPS"):
            lpips(np.zeros(a), np.zeros(b))


class _Runs:
    def __reduce__(self):
        return os.getcwd, ()


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps(_Runs()),
        pickle.dumps({"a": np.array([_Runs()], dtype=object)}),
        pickle.dumps(np.dtype([("a", "f4")])),
        pickle.dumps({"a": np.zeros(3)})[:-9],
        b"",
        b"not a pickle",
    ],
)
def test_only_plain_arrays_are_read(content: bytes) -> None:
    """A pickle that calls anything, holds objects, or is cut off is an error and is not run."""
    with pytest.raises(ModelError, match="not a pickle of plain arrays"):
        read_arrays(content)


def test_arrays_are_read() -> None:
    """Nested dictionaries of arrays, in the weights' protocol, come back as they were."""
    tree = {"layer": {"kernel": np.arange(6, dtype=np.float32).reshape(2, 3)}}
    read = read_arrays(pickle.dumps(tree, protocol=3))
    assert np.array_equal(read["layer"]["kernel"], tree["layer"]["kernel"])
