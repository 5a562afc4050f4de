"""The text of what holds arrays is short, and tells their shapes."""

from dataclasses import dataclass, field

import numpy as np

from unlit.scene.maps import Maps
from unlit.scene.short_repr import short_repr

ALBEDO = np.zeros((64, 64, 3), np.float32)


@dataclass
class Inner:
    share: float = 1 / 3
    many: np.ndarray = field(default_factory=lambda: np.zeros((5, 2)))


@dataclass
class Outer:
    inner: Inner
    name: str
    few: np.ndarray
    losses: dict[str, list[int]]
    none: None = None


def test_arrays_and_lists_are_told_by_their_size() -> None:
    """Few numbers are shown, many counted, also within what is nested; long texts are cut."""
    outer = Outer(Inner(), "x" * 100, np.array([1.0, 2.0]), {"a": [1, 2], "b": [0] * 9})
    assert short_repr(outer) == (
        "Outer(inner=Inner(share=0.3333, many=float64 (5, 2)), "
        f"name='{'x' * 60}...', few=[1.0, 2.0], losses={{a: [1, 2], b: <9 items>}}, none=None)"
    )


def test_maps() -> None:
    assert repr(Maps(ALBEDO, ALBEDO[..., 0], ALBEDO[..., 0], ALBEDO)) == (
        "Maps(diffuse_albedo=float32 (64, 64, 3), specular_albedo=float32 (64, 64), "
        "roughness=float32 (64, 64), perturbation=float32 (64, 64, 3))"
    )
