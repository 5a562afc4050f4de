"""Types of settings that carry the range of what they take, and the conversion to them."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, TypeGuard, get_args, get_origin

import msgspec
from msgspec import Meta

Share = Annotated[float, Meta(ge=0, le=1)]
Weight = Annotated[float, Meta(ge=0, le=1e6)]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
Count = Annotated[int, Meta(ge=1, le=1_000_000)]

_WORDS = {"ge": "{:g} or more", "gt": "above {:g}", "le": "at most {:g}", "lt": "below {:g}"}


def converted(value: Any, kind: Any) -> Any:
    """`value`, as Python or TOML have it, or as text, in the type `kind` and its range.

    Several numbers may be one text, with commas; ".5" is 0.5. Raises msgspec.ValidationError.
    """
    if isinstance(value, str) and kind is not str:
        value = re.sub(r"(?<![\w.])\.(?=\d)", "0.", value.strip())
        if get_origin(kind) is tuple:
            value = [part.strip() for part in value.split(",") if part.strip()]
    return msgspec.convert(value, kind, strict=False)


def is_table(value: Any) -> TypeGuard[dict[str, Any]]:
    """Whether it is a table of settings, not one value."""
    return isinstance(value, dict)


def expected(kind: Any) -> str:
    """What a setting of this type takes, in words: "int, 1 or more, at most 8"."""
    if get_origin(kind) is Literal:
        return " or ".join(get_args(kind))
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        count = "any number" if parts[1] is ... else str(len(parts))
        return f"a list of {count}, each {expected(parts[0])}"
    if get_origin(kind) is not Annotated:
        return kind.__name__
    base, bounds = get_args(kind)
    ends = ((getattr(bounds, end), text) for end, text in _WORDS.items())
    return ", ".join([base.__name__, *(text.format(x) for x, text in ends if x is not None)])
