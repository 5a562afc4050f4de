"""reconstruction.npz: the arrays of a result, to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..face.reconstruction import Fit, Reconstruction
from ..storage.arrays import Kind, check_indices, read_checked

_COLOUR, _SCALAR = Kind(("S", "S", 3)), Kind(("S", "S"))
_KINDS = {
    "image": _COLOUR,
    "vertices": Kind(("V", 3)),
    "triangles": Kind(("F", 3), "<i4"),
    "uv": Kind(("T", 2)),
    "triangle_uv": Kind(("F", 3), "<i4"),
    "diffuse_albedo": _COLOUR,
    "specular_albedo": _SCALAR,
    "roughness": _SCALAR,
    "perturbation": _COLOUR,
    "specular_normal": _COLOUR,
    "diffuse_normal": _COLOUR,
    "diffuse_shading": _COLOUR,
    "specular_shading": _COLOUR,
    "render": _COLOUR,
    "mask": _SCALAR,
    "regions": Kind(("S", "S", 6)),
    "light_axis": Kind(("K", 3)),
    "light_sharpness": Kind(("K",)),
    "light_amplitude": Kind(("K",)),
}
#: Of `Reconstruction.fit`, which older results do not have.
_FIT_KINDS = {
    "fit_vertices": Kind(("V", 3)),
    "fit_landmarks": Kind(("L", 2)),
    "fit_landmark_triangle": Kind(("L",), "<i4"),
    "fit_landmark_barycentric": Kind(("L", 3)),
}
#: Only in results with a shadow of something else.
_LIT_KINDS = {"lit": _SCALAR}
_INDEXED = {"triangles": "V", "triangle_uv": "T", "fit_landmark_triangle": "F"}
#: Where a triangle of -1 says that the mesh has no such landmark.
_LOWEST = {"fit_landmark_triangle": -1}
_AGAIN = "reconstruct the photo again"


def write_arrays(reconstruction: Reconstruction, path: Path) -> None:
    """Write the arrays of `reconstruction`, not compressed: floats of a photo hardly shrink."""
    kinds = _KINDS if reconstruction.fit is None else _KINDS | _FIT_KINDS
    kinds = kinds if reconstruction.lit is None else kinds | _LIT_KINDS
    arrays = {
        name: np.asarray(_attribute(reconstruction, name), dtype=kind.dtype)
        for name, kind in kinds.items()
    }
    np.savez(path, allow_pickle=False, **arrays)


def _attribute(reconstruction: Reconstruction, name: str) -> np.ndarray:
    part, _, field = name.partition("_")
    if part in ("light", "fit"):
        return getattr(getattr(reconstruction, part), field)
    return getattr(reconstruction, name)


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays by name, and `fit` or None. Raises OutputError that names file and array."""
    optional = _FIT_KINDS | _LIT_KINDS
    found, sizes = read_checked(path, _KINDS | optional, remedy=_AGAIN, optional=optional)
    for name, size in _INDEXED.items():
        if name in found:
            check_indices(path, name, found[name], sizes[size], _LOWEST.get(name, 0))
    fit = {name.removeprefix("fit_"): found.pop(name) for name in _FIT_KINDS if name in found}
    return {**found, "fit": Fit(**fit) if len(fit) == len(_FIT_KINDS) else None}
