"""Write a reconstruction's folder."""

from __future__ import annotations

import contextlib
import functools
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..face.reconstruction import Reconstruction
from ..progress.callbacks import StepProgress, silent
from ..storage.folder import CHECKPOINT, MARK, REPORT, STAGES, THUMBNAIL, write_all
from .arrays import write_arrays
from .export import FORMATS, Contents, job_of, told, writers_of
from .images import DISPLACEMENT_PNG, MAPS, exr, height_levels, png
from .layout import atlas_size
from .metrics import metrics_json
from .montage import montage_png
from .relit import Relit, relit
from .result_file import result_toml
from .segmentation import segmentation_png
from .textures import DISPLACEMENT, PNGS

if TYPE_CHECKING:
    from .atlas import Atlas

_FRAME = (
    "right-handed, x right, y up, camera at the origin looking along -z, centimetres; "
    "pixels: x right, y down, the first pixel's centre at (0.5, 0.5)"
)
_ARRAYS = "reconstruction.npz"
#: Every file but the maps, with what it holds.
_OTHER_FILES = {
    "light.json": "spherical Gaussians: axis, sharpness, amplitude; their colour",
    "mesh.obj": "mesh with normals and texture coordinates",
    "mesh.mtl": "its materials",
    "mesh.ply": "the same mesh, binary",
    "face.glb": "mesh, materials and textures for viewers and game engines",
    "camera.json": "pinhole camera of the crop, and where the crop lies in the photo",
    _ARRAYS: "every array, as loaded by unlit.load",
    "metrics.json": "losses by stage, timings, memory, residual of the fit",
    "montage.png": "all of it at a glance",
    "segmentation.png": "what each pixel was taken for: skin, hair, glasses, cloth",
    MARK: "this file",
}
LOG = "reconstruction.log"
#: Of the atlas and the mesh files; `unlit export` knows others.
LAYOUT = "face"
#: All names that `save` writes.
FILES = {
    **{f"{name}.exr": "linear float32" for name in MAPS},
    **{f"{name}.png": "preview" for name in MAPS},
    "displacement.exr": "millimetres over the mesh along its normal, float32",
    "displacement.png": DISPLACEMENT_PNG,
    **dict.fromkeys(PNGS, f"texture of the mesh, layout {LAYOUT}"),
    DISPLACEMENT: f"texture of the mesh, layout {LAYOUT}, {DISPLACEMENT_PNG}",
    **_OTHER_FILES,
    LOG: "what the run printed",
}
#: What a result can do without.
PAGES = (REPORT, STAGES, THUMBNAIL)
#: All names that a result's folder may have.
RESULT_FILES = frozenset({*FILES, *PAGES})
#: What makes a page's content, of the atlas and the relit pictures.
Page = Callable[["Atlas", Relit], bytes]


def needed_bytes(resolution: int) -> int:
    """Room that a result of `resolution` pixels a side and its checkpoint take, and to spare."""
    return 300 * resolution**2 + (28 << 20)


def save(
    reconstruction: Reconstruction,
    folder: str | Path,
    log: str = "",
    pages: Mapping[str, Page] | None = None,
    progress: StepProgress = silent,
) -> None:
    """Write all files of `reconstruction` into `folder`, or none; an older result is replaced.

    log: what the run said, kept as reconstruction.log. pages: by name (PAGES), what makes the
    content of a page; those of an older result go. A run's checkpoint in the
    folder is removed; files of other names stay.
    Raises OutputError if the folder cannot be written, or holds somebody else's file under one of
    the names to be written.
    """
    r = reconstruction
    progress("baking the atlas", 0, 2)
    job = replace(job_of(r, atlas_size(r), LAYOUT), light=False)
    atlas = job.atlas
    pictures = functools.cache(lambda: relit(r))  # for the montage and the pages
    texts = {
        "light.json": _json(_light(r)),
        "camera.json": _json(_camera(r)),
        "metrics.json": metrics_json(r),
        MARK: result_toml(r, FILES),
        LOG: log,
    }
    contents: Contents = {
        "montage.png": lambda: montage_png(r, pictures()),
        "segmentation.png": lambda: segmentation_png(r),
    }
    for name, (array, look) in MAPS.items():
        contents[f"{name}.exr"] = lambda array=array: exr(array(r))
        contents[f"{name}.png"] = lambda array=array, look=look: png(look(array(r)))
    contents["displacement.exr"] = lambda: exr(atlas.crop_displacement)
    contents["displacement.png"] = lambda: png(height_levels(atlas.crop_displacement))
    for name in ("glb", "obj", "ply"):
        contents |= FORMATS[name](job)
    contents |= {name: text.encode for name, text in texts.items()}
    assert {*contents, _ARRAYS} == FILES.keys()
    for name, page in (pages or {}).items():
        contents[name] = lambda page=page: page(atlas, pictures())
    writers = {**writers_of(contents), _ARRAYS: partial(write_arrays, r)}
    write_all(Path(folder), told(writers, progress), obsolete=PAGES)
    with contextlib.suppress(OSError):
        (Path(folder) / CHECKPOINT).unlink(missing_ok=True)
    progress("done", len(writers) + 1, len(writers) + 1)


def _camera(r: Reconstruction) -> dict[str, Any]:
    camera = r.face.camera
    return {
        "frame": _FRAME,
        "width": camera.width,
        "height": camera.height,
        "intrinsics": [[camera.focal, 0, camera.cx], [0, camera.focal, camera.cy], [0, 0, 1]],
        "fov_x_degrees": float(np.degrees(2 * np.arctan(0.5 * camera.width / camera.focal))),
        "photo": r.photo.name,
        "photo_to_crop": r.photo.crop.matrix,
    }


def _light(r: Reconstruction) -> dict[str, Any]:
    return {
        "model": "radiance(w) = color sum_k amplitude_k exp(sharpness_k (dot(w, axis_k) - 1))",
        "frame": _FRAME,
        "color": r.light.color,
        "axis": r.light.axis,
        "sharpness": r.light.sharpness,
        "amplitude": r.light.amplitude,
    }


def _json(value: Any) -> str:
    return (
        json.dumps(value, indent=1, ensure_ascii=False, default=lambda array: array.tolist()) + "\n"
    )
