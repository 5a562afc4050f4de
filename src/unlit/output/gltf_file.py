"""The binary glTF 2.0 container: what is where in it."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from .images import png

_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_VERTICES, _INDICES = 34962, 34963  # targets of buffer views
_LINEAR, _MIPMAPS, _CLAMP = 9729, 9987, 33071


class GltfFile:
    """Collects the binary part, and the tables that say what is where in it."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._images: list[dict[str, Any]] = []

    def vertices(self, values: np.ndarray, bounds: bool = False) -> int:
        """Accessor of (V, C) float32."""
        values = np.ascontiguousarray(values, dtype="<f4")
        limits = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self._accessor(
            values.tobytes(),
            _VERTICES,
            {
                "componentType": _FLOAT,
                "count": len(values),
                "type": f"VEC{values.shape[1]}",
                **(limits if bounds else {}),
            },
        )

    def sparse(self, values: np.ndarray, least: float) -> int:
        """Accessor of (V, 3) float32 of which only what is longer than `least` is written."""
        rows = np.flatnonzero(np.linalg.norm(values, axis=1) > least)
        rows = rows if rows.size else np.zeros(1, np.int64)  # one at least has to be there
        some = np.ascontiguousarray(values[rows], dtype="<f4")
        small = len(values) <= 1 << 16
        kept = np.zeros_like(values, dtype=np.float32)
        kept[rows] = some
        self._accessors.append(
            {
                "componentType": _FLOAT,
                "count": len(values),
                "type": "VEC3",
                "min": kept.min(axis=0).tolist(),
                "max": kept.max(axis=0).tolist(),
                "sparse": {
                    "count": len(rows),
                    "indices": {
                        "bufferView": self._view(rows.astype("<u2" if small else "<u4").tobytes()),
                        "componentType": _USHORT if small else _UINT,
                    },
                    "values": {"bufferView": self._view(some.tobytes())},
                },
            }
        )
        return len(self._accessors) - 1

    def indices(self, triangles: np.ndarray) -> int:
        """Accessor of (F, 3) indices."""
        return self._accessor(
            np.ascontiguousarray(triangles, dtype="<u4").tobytes(),
            _INDICES,
            {"componentType": _UINT, "count": triangles.size, "type": "SCALAR"},
        )

    def texture(self, name: str, pixels: np.ndarray) -> int:
        """Texture of (N, N, C) uint8."""
        view = self._view(png(pixels))
        self._images.append({"name": name, "mimeType": "image/png", "bufferView": view})
        return len(self._images) - 1

    def tables(self) -> dict[str, Any]:
        return {
            "images": self._images,
            "samplers": [
                {"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _CLAMP, "wrapT": _CLAMP}
            ],
            "textures": [{"sampler": 0, "source": index} for index in range(len(self._images))],
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._binary)}],
        }

    def packed(self, document: dict[str, Any]) -> bytes:
        """The GLB container: header, JSON chunk, binary chunk, each a multiple of four bytes."""
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = b"".join(
            struct.pack("<I4s", len(data), kind) + data
            for kind, data in ((b"JSON", text), (b"BIN\0", bytes(self._binary)))
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _accessor(self, data: bytes, target: int, accessor: dict[str, Any]) -> int:
        self._accessors.append({"bufferView": self._view(data, target), **accessor})
        return len(self._accessors) - 1

    def _view(self, data: bytes, target: int | None = None) -> int:
        place = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._views.append(place | ({"target": target} if target else {}))
        self._binary += data + b"\0" * (-len(data) % 4)
        return len(self._views) - 1
