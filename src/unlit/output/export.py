"""`unlit export`: a saved result as files for other programs, in a folder of their own."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from ..errors import SettingsError
from ..face.reconstruction import Reconstruction
from ..progress.callbacks import StepProgress, silent
from ..storage.folder import write_all
from .geometry import mtl, obj, ply, welded
from .images import DISPLACEMENT_PNG, exr, png
from .layout import LARGEST, LAYOUTS, SMALLEST, atlas_size, laid_out
from .region_map import REGION_MAP, region_map
from .scalp import SCALPS
from .textures import EXRS, MAP_FILES, PNGS

if TYPE_CHECKING:
    from .atlas import Atlas
    from .eyes import Eye

#: "photo": the head as the photo shows it. "neutral": upright, without an expression.
POSES = ("photo", "neutral")
#: Formats with the photo's camera in them, of which a neutral head has none.
_PHOTO_ONLY = ("mitsuba", "blender")
#: The file that makes a folder an export, and the words it starts with.
MARK = "export.toml"
MARK_TEXT = "# unlit export"
_MARK_BYTES = 1 << 16


@dataclass(frozen=True)
class ExportJob:
    """What the writers need.

    reconstruction: with the texture coordinates of `layout`, in `pose`, its eyeballs as its `eyes`
    look. back: path from the export's folder to the result's. light: whether the glTF file has its
    light beside it.
    """

    reconstruction: Reconstruction
    atlas: Atlas
    directx: bool
    back: str
    layout: str
    scalp: str = "skin"
    pose: str = "photo"
    eyes: tuple[Eye, ...] = ()
    light: bool = True


#: By file name: what makes its content.
Contents = dict[str, Callable[[], bytes]]
#: By file name: what writes it to the path it is given.
Writers = dict[str, Callable[[Path], object]]


def export(
    reconstruction: Reconstruction,
    folder: str | Path,
    source: str | Path,
    formats: Collection[str] | None = None,
    size: int | None = None,
    directx: bool = False,
    progress: StepProgress = silent,
    only_maps: Collection[str] = (),
    layout: str = "face",
    scalp: str = "skin",
    pose: str = "photo",
) -> Path:
    """Write `formats` (keys of FORMATS) into `folder`, all or nothing; returns the folder.

    formats: if None, all but USD, and in the pose "neutral" none that renders the photo's view.

    An export that is there is replaced: what it lists and this one does not have is removed.

    source: the folder that `reconstruction` was loaded from, which scene_unlit.xml refers to.
    size: texels a side of the atlas, 512 to 4096; by default what the crop is worth (layout.py).
    layout: where the head's parts lie in it, one of LAYOUTS. scalp: what lies under hair, one of
    SCALPS: skin, or the hair's mean colour, for which the photo has to show hair. pose: one of
    POSES. directx: y of the PNG normal maps points down.
    only_maps: keys of MAP_FILES; if there are any, these maps of the atlas are written, and no
    format.
    Raises SettingsError, ModelError or OutputError.
    """
    folder = Path(folder)
    formats = default_formats(pose) if formats is None else formats
    chosen, known = (only_maps, MAP_FILES) if only_maps else (formats, FORMATS)
    unknown = set(chosen) - known.keys()
    if unknown or not chosen:
        raise SettingsError(
            f"{', '.join(sorted(unknown)) or 'no format'}: choose from {', '.join(known)}"
        )
    if layout not in LAYOUTS:
        raise SettingsError(f"layout {layout}: choose from {', '.join(LAYOUTS)}")
    if scalp not in SCALPS:
        raise SettingsError(f"scalp {scalp}: choose from {', '.join(SCALPS)}")
    if pose not in POSES:
        raise SettingsError(f"pose {pose}: choose from {', '.join(POSES)}")
    if pose == "neutral" and (views := [name for name in chosen if name in _PHOTO_ONLY]):
        raise SettingsError(
            f"{', '.join(views)} renders the photo's view, which a neutral pose has not: "
            f"choose from {', '.join(name for name in FORMATS if name not in _PHOTO_ONLY)}"
        )
    size = atlas_size(reconstruction) if size is None else size
    if not SMALLEST <= size <= LARGEST:
        raise SettingsError(f"size {size}: choose {SMALLEST} to {LARGEST} texels")
    progress("baking the atlas", 0, 2)
    back = _way(folder.resolve(), Path(source).resolve())
    job = job_of(reconstruction, size, layout, scalp, pose, directx, back)
    contents: Contents = {}
    if only_maps:
        files = {file for name in only_maps for file in MAP_FILES[name]}
        every = _atlas_pngs(job) | _exrs(job)
        contents = {file: every[file] for file in every if file in files}
    else:
        for name in formats:
            contents |= FORMATS[name](job)
        contents |= _regions(job)
    text = _mark(job, [] if only_maps else sorted(formats), size, contents)
    contents[MARK] = text.encode
    writers = told(writers_of(contents), progress)
    write_all(folder, writers, MARK, MARK_TEXT, listed(folder))
    progress("done", len(writers) + 1, len(writers) + 1)
    return folder


def default_formats(pose: str) -> tuple[str, ...]:
    """All that can be written in the pose, without what a package of its own writes."""
    shown = (name for name in FORMATS if name != "usd")
    return tuple(name for name in shown if pose == "photo" or name not in _PHOTO_ONLY)


def job_of(
    reconstruction: Reconstruction,
    size: int,
    layout: str,
    scalp: str = "skin",
    pose: str = "photo",
    directx: bool = False,
    back: str = "",
) -> ExportJob:
    """The atlas of `reconstruction`, and its mesh in `pose`; as for `export`."""
    from .atlas import bake
    from .eyes import eyes_of, looking
    from .shapes import neutral

    eyes = eyes_of(reconstruction)
    r = looking(laid_out(reconstruction, layout), eyes)
    posed, straight = neutral(r, eyes) if pose == "neutral" else (r, eyes)
    atlas = bake(r, size, scalp, eyes)
    if posed is not r:
        atlas = replace(atlas, mesh=welded(posed))
    return ExportJob(posed, atlas, directx, back, layout, scalp, pose, straight)


def writers_of(contents: Contents) -> Writers:
    """What writes the contents to the path it is given."""

    def write(content: Callable[[], bytes], path: Path) -> None:
        path.write_bytes(content())

    return {name: partial(write, content) for name, content in contents.items()}


def told(writers: Writers, progress: StepProgress) -> Writers:
    """The same writers, which tell `progress` their file when its turn comes.

    They are all steps but the first, the atlas.
    """
    steps = len(writers) + 1

    def write(number: int, name: str, path: Path) -> None:
        progress(f"writing {name}", number, steps)
        writers[name](path)

    return {name: partial(write, 1 + n, name) for n, name in enumerate(writers)}


def _mark(job: ExportJob, formats: list[str], size: int, files: Iterable[str]) -> str:
    """The text of export.toml."""
    table = {
        "unlit": version("unlit"),
        "photo": job.reconstruction.photo.name,
        "source": job.back,
        "formats": formats,
        "size": size,
        "layout": job.layout,
        "scalp": job.scalp,
        "pose": job.pose,
        "normals": "y down (DirectX) in PNG" if job.directx else "y up (OpenGL)",
        "displacement": f"millimetres in EXR; {DISPLACEMENT_PNG} in PNG",
        "files": sorted([*files, MARK]),
    }
    return f"{MARK_TEXT}. What each file holds: docs/outputs.md of unlit.\n\n{tomli_w.dumps(table)}"


def listed(folder: Path) -> list[str]:
    """The names of the files that the export in `folder` lists; none where there is no export.

    Those that are plain only: the list may be anybody's.
    """
    try:
        with (folder / MARK).open("rb") as file:
            text = file.read(_MARK_BYTES).decode()
        names = tomllib.loads(text).get("files") if text.startswith(MARK_TEXT) else None
    except (OSError, ValueError):
        return []
    plain = re.compile(r"\w[\w-]*(\.\w+)+", re.ASCII)
    found = names if isinstance(names, list) else []
    return [name for name in found if isinstance(name, str) and plain.fullmatch(name)]


def _way(start: Path, end: Path) -> str:
    """Path of `end` from `start`, with slashes; the whole path where they are on two drives."""
    if start.drive != end.drive:
        return end.as_posix()
    return Path(os.path.relpath(end, start)).as_posix()


def _atlas_pngs(job: ExportJob) -> Contents:
    return {
        name: lambda pixels=pixels: png(pixels(job.atlas, job.directx))
        for name, pixels in PNGS.items()
    }


def _regions(job: ExportJob) -> Contents:
    r, part, size = job.reconstruction, job.atlas.part, len(job.atlas.confidence)
    regions = r.head.skin_regions
    if regions is None:
        return {}
    return {REGION_MAP: lambda: png(region_map(r, regions, part, size))}


def _glb(job: ExportJob) -> Contents:
    from .gltf import GLTF_LIGHT, glb, gltf_environment

    r, photo = job.reconstruction, job.pose == "photo"
    files: Contents = {"face.glb": lambda: glb(r, job.atlas, job.eyes, photo)}
    if photo and job.light:
        files[GLTF_LIGHT] = lambda: exr(gltf_environment(r.light.environment))
    return files


def _obj(job: ExportJob) -> Contents:
    return {
        "mesh.obj": lambda: obj(job.reconstruction, job.atlas.part, "mesh.mtl"),
        "mesh.mtl": lambda: mtl(job.atlas.part),
        **_atlas_pngs(job),
    }


def _ply(job: ExportJob) -> Contents:
    return {
        "mesh.ply": lambda: ply(job.reconstruction),
        **_atlas_pngs(job),
    }


def _exrs(job: ExportJob) -> Contents:
    return {name: lambda pixels=pixels: exr(pixels(job.atlas)) for name, pixels in EXRS.items()}


def _mitsuba(job: ExportJob) -> Contents:
    from . import mitsuba_scene as scenes

    r, atlas = job.reconstruction, job.atlas
    return {
        "scene.xml": lambda: scenes.stock_scene(r, "mesh.ply"),
        "scene_unlit.xml": lambda: scenes.own_scene(r, "mesh.ply", job.back),
        "mesh.ply": lambda: ply(r),
        scenes.TWICE_DIFFUSE: lambda: exr(2 * atlas.diffuse_albedo),
        scenes.TWICE_SPECULAR: lambda: exr(2 * atlas.specular_albedo),
        scenes.ENVIRONMENT: lambda: exr(scenes.environment(r)),
        **_exrs(job),
    }


def _blender(job: ExportJob) -> Contents:
    from . import blender

    r = job.reconstruction
    return {
        "blender.py": Path(__file__).with_name("blender_script.py").read_bytes,
        "blender.json": lambda: blender.settings(r, job.atlas),
        "environment.exr": lambda: exr(r.light.environment),
        **_obj(job),
        **_exrs(job),
    }


def _usd(job: ExportJob) -> Contents:
    from .usd import usda

    return {
        "face.usda": lambda: usda(job.atlas, job.directx),
        **_atlas_pngs(job),
    }


#: By name: what writes the format's files.
FORMATS: dict[str, Callable[[ExportJob], Contents]] = {
    "glb": _glb,
    "obj": _obj,
    "ply": _ply,
    "mitsuba": _mitsuba,
    "blender": _blender,
    "usd": _usd,
}
