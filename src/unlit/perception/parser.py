"""What every pixel of a face's crop shows: skin, hair, glass, cloth.

A residual U-Net of 1.5 million weights. It was trained only on heads that the project path-traces
itself (tools/parser_heads.py, tools/train_parser.py): no photo of a person is behind it, and it
has no idea of what a skin's colour should be. It sees the crop at 192 pixels a side, which pixels
of it the photo has, and the landmarks' contours.
"""

from __future__ import annotations

import functools
from importlib import resources

import cv2
import numpy as np

from ..color import encode_srgb
from .measures import coverage
from .topology import (
    FACE_OVAL,
    LEFT_EYE,
    LEFT_EYEBROW,
    LIPS_INNER,
    LIPS_OUTER,
    RIGHT_EYE,
    RIGHT_EYEBROW,
)

#: In the order of the network's outputs. A clear lens lies over another class; the shares of the
#: others sum to 1. Skin is that of face, ears, neck and scalp, with stubble; eyes are sclera and
#: iris; mouth is teeth, tongue and the dark between the lips; background is also what lies outside
#: of the photo.
CLASSES = (
    *("background", "skin", "lips", "eyes", "eyebrows", "mouth", "hair", "beard"),
    *("frame", "clear lens", "tinted lens", "cloth", "hand"),
)
LENS = CLASSES.index("clear lens")
OTHERS = [k for k in range(len(CLASSES)) if k != LENS]
#: Pixels a side of what the network sees.
SIZE = 192
#: What of the landmarks it is told, each line filled in a channel of its own.
CONTOURS = (
    (FACE_OVAL,),
    (RIGHT_EYE, LEFT_EYE),
    (RIGHT_EYEBROW, LEFT_EYEBROW),
    (LIPS_OUTER,),
    (LIPS_INNER,),
)


def parse(image: np.ndarray, landmarks: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(192, 192, 13) float32 in [0, 1]: of each pixel, the share of each of CLASSES.

    image: (S, S, 3) linear sRGB, a crop as photo/crop.py frames it. landmarks: (478, 2), its
    pixels. inside: (S, S), 1 where the crop is in the photo, 0 beyond. Deterministic.
    """
    encoded = encode_srgb(np.clip(_resized(image), 0, 1)).transpose(2, 0, 1) - 0.5
    drawn = contours(landmarks * (SIZE / len(image)), SIZE)
    valid = _resized(inside.astype(np.float32))
    inputs = np.concatenate([encoded, valid[None], drawn]).astype(np.float32)
    network = _network()
    network.setInput(inputs[None])
    logits = network.forward()[0].astype(np.float32)
    shares = np.empty((SIZE, SIZE, len(CLASSES)), np.float32)
    scores = np.exp(logits[OTHERS] - logits[OTHERS].max(axis=0))
    shares[..., OTHERS] = (scores / scores.sum(axis=0)).transpose(1, 2, 0)
    shares[..., LENS] = 1 / (1 + np.exp(-logits[LENS]))
    return shares


def contours(landmarks: np.ndarray, size: int) -> np.ndarray:
    """(5, size, size) float32 in [0, 1]: CONTOURS, filled; landmarks: (478, 2), pixels."""
    return np.stack(
        [
            np.max([coverage(landmarks[list(line)], size) for line in lines], axis=0)
            for lines in CONTOURS
        ]
    )


def _resized(image: np.ndarray) -> np.ndarray:
    how = cv2.INTER_AREA if len(image) >= SIZE else cv2.INTER_LINEAR
    return cv2.resize(np.ascontiguousarray(image), (SIZE, SIZE), interpolation=how)


@functools.cache
def _network() -> cv2.dnn.Net:
    file = resources.files("unlit.perception") / "parser.onnx"
    return cv2.dnn.readNetFromONNX(np.frombuffer(file.read_bytes(), np.uint8))
