"""The public face of unlit: one function for each thing that people do with it."""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import SettingsError
from .face.reconstruction import Reconstruction
from .machine import cost
from .output.export import export as export_files
from .output.load import load as load_reconstruction
from .output.montage import montage, montage_png
from .output.save import save as save_files
from .perception.landmarks import check_choice
from .pipeline import chain
from .pipeline import resume as resuming
from .progress.callbacks import silent
from .progress.console import RunConsole, StepConsole
from .relighting.lights import requested_light
from .render.relighter import Relighter
from .scene.light import SphericalGaussians
from .settings.settings import PRESETS, Settings, override

if TYPE_CHECKING:
    from .head.model import HeadModel
    from .photo.photo import Photo

#: What a light may be: a map (H, W) or (H, W, 3) of radiance, lobes, or a name or file.
AnyLight = np.ndarray | SphericalGaussians | str | Path


class Result(Reconstruction):
    """A Reconstruction that shows, relights and saves itself; a montage in notebooks.

    >>> result
    Result('array': 256 x 256 pixels, ... vertices, 648 lobes of light)
    >>> result.face.maps.diffuse_albedo.shape
    (256, 256, 3)
    """

    def relight(self, light: AnyLight) -> np.ndarray:
        """See `unlit.relight`; what does not depend on the light is computed once."""
        return self._relighter(_environment(self, light))

    @functools.cached_property
    def _relighter(self) -> Relighter:
        return Relighter(self.face)

    def save(self, folder: str | Path, *, progress: bool = True) -> None:
        """See `unlit.save`."""
        save(self, folder, progress=progress)

    def show(self) -> None:
        """Show the montage: in the notebook, else in the system's picture viewer."""
        if "IPython" in sys.modules and (shell := sys.modules["IPython"].get_ipython()):
            shell.display_pub.publish({"image/png": montage_png(self)})
            return
        from PIL import Image

        Image.fromarray(montage(self)).show()

    def _repr_png_(self) -> bytes:
        return montage_png(self)


def reconstruct(
    photo: str | Path | Photo | np.ndarray,
    preset: str | Settings = "standard",
    *,
    face: str | int = "only",
    model: HeadModel | str | None = None,
    mask: str | Path | np.ndarray | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: bool = True,
) -> Result:
    """Reconstruct the face in `photo` (paper, sections 2 and 3).

    photo: a file, a Photo, or an array (H, W, 3), uint8 sRGB-encoded or float linear sRGB.
    preset: "standard", a minute at 512 pixels; "draft", the same at 256; "paper", its Table 1 as
        printed; or a Settings. settings: what differs from it, by dotted name.
    face: "only" (several faces are an error), "largest", "left", "right", or a number counted
        from the largest, 0.
    model: the head model to fit, or its name or file, if not the one that the settings name.
    mask: a picture file or an array (H, W) of the photo's size, uint8 to 255 or others in [0, 1];
        0 leaves skin out.
    progress: show a progress bar, on a terminal or in a notebook; elsewhere plain lines.

    Raises PhotoError, FaceError, ModelError, SettingsError or MachineError.

    >>> from skimage.data import astronaut
    >>> quick = {f"stage{k}.iterations": 10 for k in range(1, 6)}
    >>> result = unlit.reconstruct(astronaut(), "draft", settings=quick, progress=False)
    """
    chosen = override(_preset(preset), dict(settings or {}))
    if isinstance(model, str):
        chosen, model = override(chosen, {"head_model": model}), None
    plan = cost.plan(chosen.resolution, chosen.iterations(), cost.cores(), chosen.solver)
    with RunConsole(plan) if progress else nullcontext(silent) as console:
        made = chain.reconstruct(
            photo, settings=chosen, face=face, model=model, mask=mask, progress=console
        )
    return _result(made)


def resume(
    result: Reconstruction | str | Path,
    stage: int,
    *,
    settings: Mapping[str, Any] | None = None,
    progress: bool = True,
) -> Result:
    """Run the stages from `stage` (1 to 5) on again, from the maps, light and mesh of `result`.

    result: or the folder where it was saved. settings: what differs from the result's own.
    Raises SettingsError or OutputError.

    >>> again = unlit.resume(result, 5, settings={"stage5.iterations": 20}, progress=False)
    >>> again.metrics.continued_from_stage
    5
    """
    if not isinstance(result, Reconstruction):
        result = load_reconstruction(result)
    chosen = override(result.settings, dict(settings or {}))
    plan = cost.plan(chosen.resolution, chosen.iterations(stage - 1), cost.cores(), chosen.solver)
    with RunConsole(plan) if progress else nullcontext(silent) as console:
        return _result(resuming.resume(result, stage, chosen, console))


def relight(result: Reconstruction, light: AnyLight) -> np.ndarray:
    """The face under another light: (S, S, 3) float32 linear sRGB, 0 outside the mask.

    light: radiance as a latitude-longitude map (H, W) or (H, W, 3) in the world frame of
    scene/camera.py, spherical Gaussians, or what `unlit relight --light` takes: "flash",
    "uniform", "side", "photo" (the reconstructed one), "sun:AZIMUTH,ELEVATION", or an .hdr or .exr
    file, which is brought to the strength of these: a white card where it gets most light renders
    as 1. Deterministic, with self-shadowing and inter-reflection, unlike the path tracer of
    `unlit relight` without --fast. `Result.relight` is faster for several lights. Raises
    SettingsError or PictureError.

    >>> unlit.relight(result, unlit.lights.sun(45, 30)).shape
    (256, 256, 3)
    """
    return Relighter(result.face)(_environment(result, light))


def save(result: Reconstruction, folder: str | Path, *, progress: bool = True) -> None:
    """Write maps, mesh, light, previews and the montage into `folder`, whole or not at all.

    Raises OutputError when it cannot be written, or holds somebody else's files.

    >>> unlit.save(result, folder, progress=False)
    """
    with StepConsole() if progress else nullcontext(silent) as report:
        save_files(result, folder, progress=report)


def load(folder: str | Path) -> Result:
    """The result that was saved in `folder`, the same to the bit. Raises OutputError.

    >>> same = unlit.load(folder)
    >>> bool((same.images.render == result.images.render).all())
    True
    """
    return _result(load_reconstruction(folder))


def export(
    folder: str | Path,
    into: str | Path | None = None,
    formats: Collection[str] | None = None,
    *,
    size: int | None = None,
    layout: str = "face",
    scalp: str = "skin",
    pose: str = "photo",
    progress: bool = True,
) -> Path:
    """Write the result saved in `folder` for other programs; returns the export's folder.

    into: FOLDER/export if None. formats: of glb, obj, ply, mitsuba, blender, usd; all but USD if
    None. size: texels a side of the textures, 512 to 4096; twice the crop's pixels if None.
    layout: "face", most of the square for the face, or "head", as the head model has it. scalp:
    under hair "skin", or "hair" for its mean colour. pose: "photo", or "neutral", upright and
    without an expression, which mitsuba and blender do not have. Raises
    SettingsError, ModelError or OutputError.

    >>> place = unlit.export(folder, formats=["ply"], progress=False)
    >>> (place / "mesh.ply").exists()
    True
    """
    if isinstance(folder, Reconstruction):
        raise SettingsError("export takes the folder of a result: save the result first")
    source = Path(folder)
    result, place = load_reconstruction(source), into or source / "export"
    with StepConsole() if progress else nullcontext(silent) as report:
        return export_files(
            *(result, place, source, formats, size),
            progress=report,
            layout=layout,
            scalp=scalp,
            pose=pose,
        )


def batch(
    photos: Sequence[str | Path],
    folder: str | Path,
    preset: str | Settings = "standard",
    *,
    face: str | int = "only",
    settings: Mapping[str, Any] | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> list[Any]:
    """Reconstruct many photos into `folder` (a path or URL), on all cores or a Dask cluster.

    photos: files. face: as for `reconstruct`, or "all". scheduler: address of a Dask scheduler.
    What is done already is not done again. Returns a row for each face: photo, folder, warnings,
    error, figures. Raises FaceError, SettingsError, OutputError or MachineError.

    >>> unlit.batch([], folder / "many")
    []
    """
    from .batches import require_extra

    require_extra()
    from .batches.run import BatchRequest, Counts, run_batch

    chosen = override(_preset(preset), dict(settings or {}))
    if face != "all":
        check_choice(face)
    files = [Path(photo).resolve() for photo in photos]

    def watch(counts: Counts, rows: list[Any]) -> None:
        del rows
        if counts.photos:
            report("photos", counts.finished, counts.photos)

    with StepConsole() if progress else nullcontext(silent) as report:
        return run_batch(BatchRequest(files, str(folder), chosen, face, scheduler), watch)


def _environment(result: Reconstruction, light: AnyLight) -> np.ndarray | SphericalGaussians:
    """The light as `Relighter` takes it; names and files as `unlit relight` does."""
    if isinstance(light, SphericalGaussians):
        return light
    if isinstance(light, np.ndarray):
        if light.ndim not in (2, 3) or light.shape[2:] not in ((), (3,)):
            raise SettingsError(f"light of shape {light.shape}: give a map (H, W) or (H, W, 3)")
        return light
    return requested_light(str(light), result.light)


def _preset(preset: str | Settings) -> Settings:
    if isinstance(preset, Settings):
        return preset
    if preset not in PRESETS:
        raise SettingsError(f"preset={preset!r}: choose {' or '.join(PRESETS)}")
    return PRESETS[preset]


def _result(made: Reconstruction) -> Result:
    return Result(**{field.name: getattr(made, field.name) for field in dataclasses.fields(made)})
