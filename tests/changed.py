"""Other values in the nested parts of a result, which is frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def changed(whole: T, parts: Mapping[str, object]) -> T:
    """`whole` with other values at dotted places, such as "face.maps.roughness"."""
    for place, value in parts.items():
        name, _, rest = place.partition(".")
        inner = changed(getattr(whole, name), {rest: value}) if rest else value
        whole = replace(whole, **{name: inner})
    return whole


def part(whole: Any, place: str) -> Any:
    """What is at a dotted place."""
    for name in place.split("."):
        whole = getattr(whole, name)
    return whole
