"""Videos are read back and compared with their frames."""

import io
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image

from unlit.errors import MachineError
from unlit.relighting.video import gif, mp4, need_encoder


def frames(height: int = 48, width: int = 64) -> Iterator[np.ndarray]:
    """A bright bar that moves over a gradient."""
    for k in range(5):
        pixels = np.empty((height, width, 3), np.uint8)
        pixels[...] = np.linspace(20, 200, width)[:, None] * (1.0, 0.8, 0.6)
        pixels[:, 10 * k : 10 * k + 8] = (230, 60, 60)
        yield pixels


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / (np.mean((a.astype(float) - b) ** 2) + 1e-9)))


@pytest.mark.parametrize("size", [(48, 64), (47, 63)])
def test_mp4(size: tuple[int, int]) -> None:
    """All frames in order, at their rate; sides made even."""
    av = pytest.importorskip("av")
    with av.open(io.BytesIO(mp4(frames(*size), 25))) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 25)
        found = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(found) == 5
    assert found[0].shape == (48, 64, 3)
    for ours, true in zip(found, frames(*size), strict=True):
        assert psnr(ours[: size[0], : size[1]], true) > 28


def test_gif() -> None:
    """All frames in order, 40 ms each, endless."""
    with Image.open(io.BytesIO(gif(frames(), 25))) as picture:
        assert picture.n_frames == 5  # type: ignore[attr-defined]
        assert (picture.info["duration"], picture.info["loop"]) == (40, 0)
        for number, true in enumerate(frames()):
            picture.seek(number)
            assert psnr(np.asarray(picture.convert("RGB")), true) > 30


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line that names the extra and the way around."""
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MachineError, match=r'"unlit\[video\]", or write a \.gif') as caught:
        need_encoder()
    assert "\n" not in str(caught.value)
