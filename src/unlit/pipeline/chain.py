"""The one chain from a photo to a result (paper, sections 2 and 3).

    observe > fit_head > estimate_conditions > solve > assemble

The first three steps may be replaced by what is known: a subject's true mesh and camera, or what
a saved result kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..conditions import illuminant
from ..conditions.estimate import estimate_conditions
from ..face.conditions import Conditions
from ..face.gain import AlbedoGain
from ..face.head import FittedHead
from ..face.photo import FacePhoto
from ..face.reconstruction import Reconstruction
from ..fit.head import fit_head
from ..head.model import HeadModel
from ..head.sources.library import head_model, model_key
from ..optimize.checkpoint import Checkpoint
from ..optimize.run_record import RunRecord
from ..optimize.solve import Keeper, Solution, solve
from ..perception.landmarks import DetectedFace, check_choice
from ..perception.mask import read_mask
from ..photo.photo import Photo, read_photo
from ..progress.callbacks import StageProgress, silent
from ..scene.camera import Camera
from ..settings.settings import PRESETS, Settings
from ..settings.table1 import LAST_STAGE
from .assemble import assemble
from .identity import identity_of, photo_content
from .observe import observe

Made = TypeVar("Made")
#: Called with (stage, the result so far) after the fit and after every stage.
Preview = Callable[[str, Reconstruction], None]

FitHead = Callable[[FacePhoto, Settings], FittedHead]


@dataclass(frozen=True)
class Steps:
    """The steps before the stages. kept: they only hand on what an earlier run found."""

    observe: Callable[[Settings], FacePhoto]
    fit_head: FitHead
    estimate_conditions: Callable[[FacePhoto, FittedHead, Settings], Conditions]
    kept: bool = False


def steps_of(
    photo: Photo,
    fit: FitHead,
    face: str | int | DetectedFace = "only",
    mask: np.ndarray | None = None,
    camera: Camera | None = None,
) -> Steps:
    """The steps for a photo; arguments as for `observe`, and how a head is fitted to it."""

    def seen(settings: Settings) -> FacePhoto:
        found = observe(photo, settings.resolution, face, camera, mask)
        _check_known(found, photo, settings)
        return found

    def conditions(seen: FacePhoto, head: FittedHead, settings: Settings) -> Conditions:
        return estimate_conditions(seen, head, photo, settings)

    return Steps(seen, fit, conditions)


def fitting(model: HeadModel) -> FitHead:
    """The step that fits `model`."""
    return lambda seen, settings: fit_head(seen, model, settings)


def known_mesh(vertices: np.ndarray, triangles: np.ndarray) -> FitHead:
    """The step that takes a mesh which is known, as for `FittedHead.of_mesh`."""
    return lambda seen, _: FittedHead.of_mesh(vertices, triangles, seen.landmarks)


def run_chain(
    steps: Steps,
    settings: Settings,
    run: RunRecord,
    keeper: Keeper | None = None,
    preview: Preview | None = None,
) -> Reconstruction:
    """All steps in order. Raises FaceError, SettingsError or OutputError."""

    def timed(step: str, make: Callable[[], Made]) -> Made:
        if steps.kept:
            return make()
        run.begins(step)
        made = make()
        run.lap(step)
        return made

    photo = timed("perception", lambda: steps.observe(settings))
    head = timed("fit", lambda: steps.fit_head(photo, settings))
    conditions = timed("conditions", lambda: steps.estimate_conditions(photo, head, settings))

    def show(stage: str, solution: Solution) -> None:
        if preview is not None:
            preview(stage, assemble(photo, head, conditions, solution, run))

    shown = None if preview is None else show
    solution = solve(photo, head, conditions, settings, run, keeper, shown)
    run.begins("finish")
    result = assemble(photo, head, conditions, solution, run)
    if preview is not None:
        preview(LAST_STAGE, result)
    return result


def reconstruct(
    photo: str | Path | Photo | np.ndarray,
    *,
    settings: Settings = PRESETS["standard"],
    face: str | int | DetectedFace = "only",
    model: HeadModel | None = None,
    mask: str | Path | np.ndarray | None = None,
    progress: StageProgress = silent,
    preview: Preview | None = None,
    checkpoint: Checkpoint | None = None,
) -> Reconstruction:
    """Reconstruct the face in `photo`.

    photo: a file, a Photo, or an array (H, W, 3): uint8 sRGB-encoded or float linear sRGB.
    face: "only" (several faces are an error), "largest", "left" or "right" (the leftmost or
        rightmost in the picture), a number counted from the largest, 0, or one that was found.
    model: the head model to fit; the default is the one that the settings name.
    mask: a picture file or an array (H, W) of the photo's size, uint8 to 255 or others in [0, 1]; 0
        leaves skin out.
    progress: called with (stage, iteration, iterations, loss). preview: called with the result so
    far after the fit and after every stage. checkpoint: where the state is kept after every stage,
    and from where it is resumed; `save` removes it from the result's folder.

    Raises PhotoError, FaceError, ModelError, SettingsError, OutputError or MachineError.
    """
    if not isinstance(face, DetectedFace):
        check_choice(face)
    run = RunRecord(progress)
    run.begins("photo")
    loaded = _as_photo(photo)
    kept = None if mask is None else read_mask(mask, loaded)
    model = model or head_model(settings.head_model)
    if checkpoint is not None:
        name, content = Path(loaded.source).name, photo_content(loaded)
        checkpoint.belongs_to(identity_of(name, content, settings, model_key(model), face, kept))
    run.lap("photo")
    return run_chain(
        steps_of(loaded, fitting(model), face, kept), settings, run, checkpoint, preview
    )


def _as_photo(photo: str | Path | Photo | np.ndarray) -> Photo:
    if isinstance(photo, Photo):
        return photo
    if isinstance(photo, np.ndarray):
        return Photo.of(photo)
    return read_photo(photo)


def _check_known(seen: FacePhoto, photo: Photo, settings: Settings) -> None:
    """Raise SettingsError, before the long work, for what the photo cannot tell as it was told."""
    card = settings.light_color.card
    if card is not None:
        illuminant.of_card(photo, card)
    AlbedoGain(settings.exposure, seen, Conditions()).patch(seen.regions.face > 0.5)
