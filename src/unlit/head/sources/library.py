"""Head models by name or file, and adding one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import ModelError
from ...progress.callbacks import StepProgress
from ...storage.keys import key
from ..files import DEFAULT, SUFFIX, added, model_file, models_folder
from ..model import HeadModel
from . import ict, makehuman

#: Landmarks of a face span so much, cm: neither inches nor millimetres nor metres do.
_FACE = (8.0, 40.0)


def default_model() -> HeadModel:
    """The head model used when the user names none: MakeHuman's, built once and cached."""
    return makehuman.cached_model()


def head_model(name: str) -> HeadModel:
    """The default model, an added one by name, or that in a file. Raises ModelError."""
    if name == DEFAULT:
        return default_model()
    if file := model_file(name):
        return _of_file(file)
    known = added()
    hint = "" if "ict" in known else "; `unlit models add ict FOLDER` adds ICT-FaceKit"
    raise ModelError(
        f"{name}: no such head model; give {', '.join((DEFAULT, *known))} or an .npz file{hint}"
    )


def model_key(model: HeadModel) -> str:
    """Changes with anything that `model` holds."""
    return key(*model.content().values())


def _of_file(path: Path) -> HeadModel:
    model = HeadModel.load(path)
    points = model.landmarks(model.neutral)
    points = points[np.isfinite(points).all(axis=1)]
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if not _FACE[0] <= size <= _FACE[1]:
        raise ModelError(
            f"{path}: its landmarks span {size:.3g} cm, a face's some 17; give 'neutral', "
            "'identity' and 'expression' in centimetres, and landmarks all over the face"
        )
    return model


def add(name: str, source: Path, progress: StepProgress) -> Path:
    """Build the model `name` from the files in `source` and keep it; returns its path.

    Raises ModelError.
    """
    if name != "ict":
        raise ModelError(f"{name}: no such head model to add; there is ict (ICT-FaceKit)")
    if not source.is_dir():
        raise ModelError(f"{source}: not a folder; give FaceXModel of a copy of ICT-FaceKit")
    model = ict.build(source, default_model, progress)
    place = models_folder() / f"{name}{SUFFIX}"
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        model.save(place)
    except OSError as error:
        raise ModelError(f"{place}: cannot be written ({error.strerror})") from error
    return place
