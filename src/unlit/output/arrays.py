"""reconstruction.npz: the arrays of a result, to the bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..face.reconstruction import Reconstruction
from ..head.skin_regions import SKIN_REGIONS
from ..perception.parser import CLASSES
from ..perception.parser import SIZE as PARSED
from ..storage.arrays import Kind, check_indices, read_checked

_COLOUR, _SCALAR = Kind(("S", "S", 3)), Kind(("S", "S"))
#: For each array of the file, where it is in a Reconstruction, and what it has to be.
_ARRAYS = {
    "image": ("photo.image", _COLOUR),
    "regions": ("photo.regions.weights", Kind(("S", "S", 6))),
    "shares": ("photo.regions.shares", Kind((PARSED, PARSED, len(CLASSES)))),
    "landmarks": ("photo.landmarks", Kind(("M", 3), "<f8")),
    "vertices": ("face.mesh.vertices", Kind(("V", 3))),
    "triangles": ("face.mesh.triangles", Kind(("F", 3), "<i4")),
    "uv": ("face.mesh.uv", Kind(("T", 2))),
    "triangle_uv": ("face.mesh.triangle_uv", Kind(("F", 3), "<i4")),
    "fit_vertices": ("head.mesh.vertices", Kind(("V", 3))),
    "fit_landmarks": ("head.landmarks", Kind(("L", 2))),
    "fit_landmark_triangle": ("head.landmark_points.triangle", Kind(("L",), "<i4")),
    "fit_landmark_barycentric": ("head.landmark_points.barycentric", Kind(("L", 3))),
    "unit": ("head.motion.unit", Kind(("N",), "<i4")),
    "unit_vertex": ("head.motion.vertex", Kind(("N",), "<i4")),
    "unit_displacement": ("head.motion.displacement", Kind(("N", 3))),
    "expression": ("head.motion.expression", Kind(("E",))),
    "head_rotation": ("head.motion.rotation", Kind((3, 3), "<f8")),
    "head_translation": ("head.motion.translation", Kind((3,), "<f8")),
    "skin_regions": ("head.skin_regions", Kind(("V", len(SKIN_REGIONS)))),
    "diffuse_albedo": ("face.maps.diffuse_albedo", _COLOUR),
    "specular_albedo": ("face.maps.specular_albedo", _SCALAR),
    "roughness": ("face.maps.roughness", _SCALAR),
    "perturbation": ("face.maps.perturbation", _COLOUR),
    "specular_normal": ("face.normals.specular", _COLOUR),
    "diffuse_normal": ("face.normals.diffuse", _COLOUR),
    "mask": ("face.mask", _SCALAR),
    "light_axis": ("light.axis", Kind(("K", 3))),
    "light_sharpness": ("light.sharpness", Kind(("K",))),
    "light_amplitude": ("light.amplitude", Kind(("K",))),
    "diffuse_shading": ("images.diffuse_shading", _COLOUR),
    "specular_shading": ("images.specular_shading", _COLOUR),
    "render": ("images.render", _COLOUR),
    "shadow_visibility": ("conditions.shadow.visibility", _SCALAR),
    "shadow_remaining": ("conditions.shadow.remaining", _COLOUR),
    "shadow_trust": ("conditions.shadow.trust", _SCALAR),
    "sun": ("conditions.shadow.sun", Kind((3,))),
    "tint": ("conditions.tint", _COLOUR),
}
#: Of a head model that was fitted: all or none, and names of its units besides.
MOTION = ("unit", "unit_vertex", "unit_displacement", "expression")
MOTION += ("head_rotation", "head_translation")
#: Only in results of a fitted head, that the parser was asked for, with a shadow, a sun, a tint,
#: of a head with regions of the skin.
_OPTIONAL = (
    *MOTION,
    "skin_regions",
    "shares",
    "shadow_visibility",
    "shadow_remaining",
    "shadow_trust",
)
_OPTIONAL += ("sun", "tint", "skin_regions")
#: What indexes into arrays of which size, and the lowest index: -1 where the mesh has no landmark.
_INDEXED = {"triangles": ("V", 0), "triangle_uv": ("T", 0), "fit_landmark_triangle": ("F", -1)}
_INDEXED |= {"unit": ("E", 0), "unit_vertex": ("V", 0)}
_AGAIN = "reconstruct the photo again"


def write_arrays(reconstruction: Reconstruction, path: Path) -> None:
    """Write the arrays of `reconstruction`, not compressed: floats of a photo hardly shrink."""
    arrays = {}
    for name, (place, kind) in _ARRAYS.items():
        value = reconstruction
        for part in place.split("."):
            value = None if value is None else getattr(value, part)
        if value is not None:
            arrays[name] = np.asarray(value, dtype=kind.dtype)
    np.savez(path, allow_pickle=False, **arrays)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays by name. Raises OutputError that names file and array."""
    kinds = {name: kind for name, (_, kind) in _ARRAYS.items()}
    found, sizes = read_checked(path, kinds, remedy=_AGAIN, optional=_OPTIONAL)
    for name, (size, low) in _INDEXED.items():
        if name not in found:
            continue
        check_indices(path, name, found[name], sizes[size], low)
    return found
