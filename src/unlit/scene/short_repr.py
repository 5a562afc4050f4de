"""The `repr` of what holds large arrays: their types and shapes in place of their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

#: Longer arrays, lists and texts are told by their size.
_ITEMS, _LETTERS = 4, 60


def short_repr(self: Any) -> str:
    """The fields of a dataclass, as its `__repr__`: Maps(roughness=float32 (256, 256), ...)."""
    parts = (f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self))
    return f"{type(self).__name__}({', '.join(parts)})"


def _short(value: Any) -> str:
    if is_dataclass(value):
        return short_repr(value)
    match value:
        case np.ndarray() if value.size > _ITEMS:
            return f"{value.dtype} {value.shape}"
        case np.ndarray():
            return repr(value.tolist())
        case float():
            return f"{value:.4g}"
        case str() if len(value) > _LETTERS:
            return repr(f"{value[:_LETTERS]}...")
        case Mapping():
            return f"{{{', '.join(f'{name}: {_short(value[name])}' for name in value)}}}"
        case list() | tuple() if len(value) > _ITEMS:
            return f"<{len(value)} items>"
        case list() | tuple():
            return f"[{', '.join(map(_short, value))}]"
        case _:
            return repr(value)
