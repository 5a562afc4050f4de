"""The head model fitted to a photo: to its landmarks and outline, then to its shading, too."""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_limits

from ..face.face import PosedMesh
from ..face.head import FittedHead, Motion
from ..face.photo import FacePhoto
from ..head.model import HeadModel
from ..head.skin_regions import skin_regions
from ..perception.mouth import teeth
from ..settings.settings import Settings
from .landmarks import LandmarkProblem
from .outline import Outline
from .shading import ShadingProblem
from .state import State
from .teeth import teeth_placed, without_teeth

#: Displacements below this are none, cm.
_LEAST = 1e-4


def fit_head(photo: FacePhoto, model: HeadModel, settings: Settings) -> FittedHead:
    """`model` fitted to the photo (paper, section 2.1). Raises FaceError."""
    closed = bool(photo.regions.mouth.max() < 0.5)
    problem = landmark_problem(photo, without_teeth(model), settings)
    with threadpool_limits(1, user_api="blas"):
        shading = ShadingProblem(problem, photo.image, photo.regions, settings.shading_fit)
        fit = shading.solve(problem.solve(closed), closed)
    shown = teeth(photo.image, photo.landmarks[:, :2], photo.regions.mouth)
    vertices = teeth_placed(model, fit.vertices, fit.state, photo.camera, shown)
    return FittedHead(
        PosedMesh(vertices, model.triangles, model.uv, model.triangle_uv),
        fit.landmarks.astype("float32"),
        model.landmark_points,
        fit.landmark_residual,
        f"{model.name}, {model.licence}",
        motion(model, fit.state),
        skin_regions(model),
    )


def motion(model: HeadModel, state: State) -> Motion:
    """The units of `model`, and the pose and expression of `state`."""
    unit, vertex = np.nonzero(np.abs(model.expression).max(axis=2) > _LEAST)
    return Motion(
        model.expression_names,
        unit.astype(np.int32),
        vertex.astype(np.int32),
        model.expression[unit, vertex],
        np.asarray(state.expression, np.float32),
        np.asarray(state.rotation, np.float64),
        np.asarray(state.translation, np.float64),
    )


def landmark_problem(photo: FacePhoto, model: HeadModel, settings: Settings) -> LandmarkProblem:
    """Of the photo's landmarks, and of its outline where the parser has told skin from background.

    Raises FaceError.
    """
    outline = None
    if photo.regions.shares is not None:
        outline = Outline(model, photo.camera, photo.regions, settings.outline_fit)
    known = (model, photo.landmarks, photo.camera, settings.landmark_fit)
    return LandmarkProblem(*known, image=photo.image, outline=outline)
