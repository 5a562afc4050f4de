"""LPIPS: how different two pictures look, by the features of AlexNet.

Zhang et al. 2018, "The unreasonable effectiveness of deep features as a perceptual metric",
version 0.1 with the authors' linear weights: the features of five layers are normalised to unit
length per position, and the squared differences weighted and added over channels. Plain NumPy:
five convolutions as products of matrices.

The weights are a pickle of NumPy arrays. It is verified before it is opened (machine/assets.py),
and the reader can make arrays and nothing else.
"""

from __future__ import annotations

import functools
import io
import pickle
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..errors import ModelError
from ..machine.assets import asset

ASSET = "lpips-alexnet"

#: The network's input is (x - SHIFT) / SCALE of encoded values in [-1, 1].
SHIFT = np.array([-0.030, -0.088, -0.188], dtype=np.float32)
SCALE = np.array([0.458, 0.448, 0.450], dtype=np.float32)

#: AlexNet's convolutions: stride, zero padding, and whether pooling comes before.
_LAYERS = ((4, 2, False), (1, 2, True), (1, 1, True), (1, 1, False), (1, 1, False))
#: Smallest side whose picture survives all pooling.
SMALLEST = 31


def lpips(image: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Distance of two sRGB-encoded pictures (H, W, 3) in [0, 1]; 0 for the same picture.

    Averaged over the picture, as its authors do; with `mask` (H, W) over the positions of each
    layer inside it, each counting by the share of its patch of pixels that is inside. Raises
    ValueError for shapes that differ or are too small, ModelError where the weights cannot be had.
    """
    if image.shape != truth.shape or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"LPIPS compares (H, W, 3) with itself, not {image.shape}, {truth.shape}")
    if min(image.shape[:2]) < SMALLEST:
        raise ValueError(f"LPIPS needs {SMALLEST} pixels a side, not {image.shape[:2]}")
    total = 0.0
    convolutions, heads = _weights()
    for a, b, head in zip(
        _features(image, convolutions), _features(truth, convolutions), heads, strict=True
    ):
        distance = np.square(_unit(a) - _unit(b)) @ head
        total += _mean(distance, mask)
    return float(total)


def _mean(distance: np.ndarray, mask: np.ndarray | None) -> float:
    if mask is None:
        return float(distance.mean())
    rows, columns = (_shares(m, n) for m, n in zip(mask.shape, distance.shape, strict=True))
    weight = rows @ mask.astype(np.float32) @ columns.T
    return float((distance * weight).sum() / max(weight.sum(), 1e-12))


def _shares(length: int, parts: int) -> np.ndarray:
    """(parts, length): how much of each pixel lies in each of `parts` equal patches of a line."""
    edges = np.arange(parts + 1) * (length / parts)
    pixel = np.arange(length)
    low, high = edges[:-1, None], edges[1:, None]
    overlap = np.minimum(high, pixel + 1) - np.maximum(low, pixel)
    return (np.maximum(overlap, 0) * (parts / length)).astype(np.float32)


def _unit(features: np.ndarray) -> np.ndarray:
    return features / (np.sqrt(np.square(features).sum(axis=-1, keepdims=True)) + 1e-10)


def _features(
    encoded: np.ndarray, convolutions: tuple[tuple[np.ndarray, np.ndarray], ...]
) -> list[np.ndarray]:
    """The five rectified layers (h, w, channels) of AlexNet."""
    x = (2 * np.asarray(encoded, dtype=np.float32) - 1 - SHIFT) / SCALE
    layers = []
    for (kernel, bias), (stride, padding, pooled) in zip(convolutions, _LAYERS, strict=True):
        if pooled:
            x = sliding_window_view(x, (3, 3), axis=(0, 1))[::2, ::2].max(axis=(-2, -1))
        x = np.maximum(_convolve(x, kernel, stride, padding) + bias, 0)
        layers.append(x)
    return layers


def _convolve(x: np.ndarray, kernel: np.ndarray, stride: int, padding: int) -> np.ndarray:
    """Cross-correlation of (H, W, C) with a kernel (K, K, C, N) by one product of matrices."""
    size, _, channels, out = kernel.shape
    x = np.pad(x, ((padding, padding), (padding, padding), (0, 0)))
    patches = sliding_window_view(x, (size, size), axis=(0, 1))[::stride, ::stride]
    height, width = patches.shape[:2]
    columns = patches.transpose(0, 1, 3, 4, 2).reshape(height * width, size * size * channels)
    return (columns @ kernel.reshape(-1, out)).reshape(height, width, out)


@functools.cache
def _weights() -> tuple[tuple[tuple[np.ndarray, np.ndarray], ...], tuple[np.ndarray, ...]]:
    """Convolutions (kernel (K, K, C, N), bias (N,)) and the authors' weights (N,) per layer."""
    path = asset(ASSET)
    tree = read_arrays(path.read_bytes())
    try:
        layers = [tree["AlexNet_0"][f"Conv_{k}"] for k in range(5)]
        heads = [tree[f"NetLinLayer_{k}"]["Conv_0"]["kernel"].ravel() for k in range(5)]
        return tuple((layer["kernel"], layer["bias"]) for layer in layers), tuple(heads)
    except (KeyError, TypeError, AttributeError) as error:
        raise ModelError(
            f"{path}: not the weights of LPIPS; delete it to fetch it again"
        ) from error


def read_arrays(content: bytes) -> Any:
    """The nested dictionaries of arrays in a pickle. Raises ModelError if it asks for more."""
    try:
        return _ArraysOnly(io.BytesIO(content)).load()
    except (pickle.UnpicklingError, EOFError, ValueError, IndexError, KeyError, TypeError) as error:
        raise ModelError(f"LPIPS weights: not a pickle of plain arrays ({error})") from error


class _ArraysOnly(pickle.Unpickler):
    """Refuses every global but the three that an array is made of."""

    def find_class(self, module: str, name: str) -> Any:
        match module, name:
            case (("numpy.core.multiarray" | "numpy._core.multiarray"), "_reconstruct"):
                return _reconstruct
            case "numpy", "ndarray":
                return np.ndarray
            case "numpy", "dtype":
                return _dtype
        raise pickle.UnpicklingError(f"it names {module}.{name}")


def _reconstruct(kind: Any, shape: Any, code: Any) -> np.ndarray:
    if kind is not np.ndarray:
        raise pickle.UnpicklingError("it makes something else than an array")
    return np.ndarray.__new__(np.ndarray, (0,), np.dtype("i1"))


def _dtype(code: str, align: bool = False, copy: bool = False) -> np.dtype[Any]:
    # An array of objects would unpickle what it holds.
    if code not in ("f4", "f8", "i4", "i8"):
        raise pickle.UnpicklingError(f"it holds values of type {code!r}")
    return np.dtype(code)
