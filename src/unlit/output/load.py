"""Read a reconstruction's folder: nothing in it is trusted."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from ..errors import OutputError, SettingsError
from ..face.conditions import Conditions, Shadow
from ..face.face import Face, Normals, PosedMesh
from ..face.head import FittedHead, Motion
from ..face.photo import FacePhoto
from ..face.reconstruction import Images, Reconstruction
from ..perception.regions import Regions
from ..scene.light import SphericalGaussians
from ..scene.maps import Maps
from ..scene.surface_points import SurfacePoints
from ..settings.settings import PRESETS, override
from ..storage.folder import MARK
from ..storage.tables import place_of
from .arrays import MOTION, read_arrays
from .metrics import read_metrics
from .result_file import read_result_file


def load(folder: str | Path) -> Reconstruction:
    """The reconstruction that was saved in `folder`, the same to the bit.

    Raises OutputError that names the file and the field that is missing or wrong.
    """
    path = _mark_of(Path(folder))
    file = read_result_file(path)
    arrays = read_arrays(path.with_name("reconstruction.npz"))
    size = len(arrays["image"])
    if file.camera.width != size:
        raise OutputError(
            f"{path}: camera and crop are {file.camera.width} pixels wide, the maps {size}; "
            "reconstruct the photo again"
        )
    try:
        settings = override(PRESETS["paper"], file.settings)
    except SettingsError as error:
        place = place_of(path, f"settings.{error.argument}")
        raise OutputError(f"{place}: settings: {error}") from error
    kept = read_metrics(path.with_name("metrics.json"))
    color = np.array(file.light.color, dtype=np.float32)
    mesh = PosedMesh(*(arrays[n] for n in ("vertices", "triangles", "uv", "triangle_uv")))
    points = SurfacePoints(arrays["fit_landmark_triangle"], arrays["fit_landmark_barycentric"])
    return Reconstruction(
        FacePhoto(
            file.photo,
            arrays["image"],
            file.camera,
            file.crop,
            Regions(arrays["regions"], arrays.get("shares")),
            arrays["landmarks"],
            kept.unit_cd_m2,
        ),
        FittedHead(
            replace(mesh, vertices=arrays["fit_vertices"]),
            arrays["fit_landmarks"],
            points,
            kept.landmark_residual,
            kept.head_model,
            _motion_of(arrays, file.units, path),
            arrays.get("skin_regions"),
        ),
        Conditions(color, kept.light_color, _shadow_of(arrays), arrays.get("tint")),
        Face(
            file.camera,
            mesh,
            Maps(*(arrays[field.name] for field in fields(Maps))),
            Normals(arrays["specular_normal"], arrays["diffuse_normal"]),
            arrays["mask"],
        ),
        SphericalGaussians(
            *(arrays[f"light_{name}"] for name in ("axis", "sharpness", "amplitude")), color=color
        ),
        Images(*(arrays[field.name] for field in fields(Images))),
        file.light.gain,
        settings,
        kept.metrics(),
    )


def _motion_of(arrays: dict[str, np.ndarray], names: tuple[str, ...], path: Path) -> Motion | None:
    """None in results that were saved without, and of heads that were not fitted."""
    if not set(MOTION) <= set(arrays):
        return None
    count = len(arrays["expression"])
    if len(names) != count:
        raise OutputError(
            f"{path}: head.units has {len(names)} names, the arrays have {count} units; "
            "reconstruct the photo again"
        )
    return Motion(names, *(arrays[name] for name in MOTION))


def _shadow_of(arrays: dict[str, np.ndarray]) -> Shadow | None:
    names = [f"shadow_{name}" for name in ("visibility", "remaining", "trust")]
    if not set(names) <= set(arrays):
        return None
    visibility, remaining, trust = (arrays[name] for name in names)
    return Shadow(visibility, remaining, trust, arrays.get("sun"))


def _mark_of(folder: Path) -> Path:
    """The file that makes `folder` a result."""
    if not (folder / MARK).exists():
        what = f"{MARK} is missing" if folder.is_dir() else "no such folder"
        raise OutputError(
            f"{folder}: no result of unlit ({what}); give a folder that `unlit reconstruct` wrote"
        )
    return folder / MARK
