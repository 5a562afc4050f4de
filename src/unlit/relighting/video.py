"""Frames to an MP4 or GIF file, in memory: a file appears whole or not at all."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
from PIL import Image

from ..errors import MachineError

#: Quality of H.264: 0 is lossless, 18 hard to tell from it, 23 its own default.
_CRF = "17"
_BT709 = 1


def need_encoder() -> Any:
    """The package that writes MP4. Raises MachineError where it is missing."""
    try:
        import av
    except ImportError as error:
        raise MachineError(
            'MP4 needs the package av: pip install "unlit[video]", or write a .gif'
        ) from error
    return av


def mp4(frames: Iterator[np.ndarray], fps: int) -> bytes:
    """H.264 in MP4 of `frames` (H, W, 3) uint8 sRGB; an odd last row or column is repeated.

    Raises MachineError.
    """
    av = need_encoder()
    stream: Any = None
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        for number, pixels in enumerate(frames):
            even = [(0, side % 2) for side in pixels.shape[:2]]
            pixels = np.pad(pixels, (*even, (0, 0)), mode="edge")
            if stream is None:
                stream = container.add_stream("libx264", rate=fps, options={"crf": _CRF})
                stream.height, stream.width = pixels.shape[:2]
                stream.pix_fmt = "yuv420p"
                context = stream.codec_context
                context.color_primaries = context.color_trc = context.colorspace = _BT709
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace=_BT709)
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return file.getvalue()


def gif(frames: Iterator[np.ndarray], fps: int) -> bytes:
    """An endless GIF of `frames` (H, W, 3) uint8 sRGB, each with its own 256 colours.

    The format counts time in hundredths of a second.
    """

    def reduced(pixels: np.ndarray) -> Image.Image:
        return Image.fromarray(pixels).quantize(256, Image.Quantize.MEDIANCUT)

    pictures = map(reduced, frames)
    first = next(pictures)
    file = io.BytesIO()
    first.save(
        file,
        "GIF",
        save_all=True,
        append_images=pictures,
        duration=round(100 / fps) * 10,
        loop=0,
    )
    return file.getvalue()
