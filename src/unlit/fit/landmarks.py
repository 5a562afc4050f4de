"""Fit the head model's pose, identity and expression to dense landmarks and the head's outline.

The landmarker's points lie some 3 % of the eye distance beside the true ones, and neighbours err
together, so 478 of them are worth only a few independent measurements. The fit therefore trusts
the contours it can name (lips, eyelids, nose, the face's outline across itself) and gives every
point a large standard deviation against the identity's unit prior: a tight fit ends with worse
normals than the mean head. What the landmarker gets wrong on average on a head turned this way
(landmark_error.py) is taken off as the pose is found. Gauss-Newton with Huber weights; the focal
length is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from ..errors import FaceError
from ..head.contact import lids_outside_eyes, seal_lips
from ..head.landmark_error import LandmarkError, shipped_error
from ..head.model import LANDMARKS, HeadModel
from ..head.procrustes import procrustes
from ..perception.measures import tangents
from ..perception.mouth import relative_gap
from ..perception.topology import (
    FACE_OVAL,
    LEFT_EYE,
    LEFT_LID_GAP,
    LIP_GAP,
    LIPS_INNER,
    LIPS_OUTER,
    RIGHT_EYE,
    RIGHT_LID_GAP,
)
from ..scene.camera import Camera
from ..settings.fit import LandmarkFit
from .outline import Outline
from .registration import registered
from .state import STATED_RESOLUTION, State, camera_motion, carried

# Midline from the root of the nose to the chin, and the nose's wings and base.
NOSE_AND_MIDLINE = (168, 6, 197, 195, 5, 4, 1, 19, 94, 2, 164, 18, 200, 199, 175)
NOSE_AND_MIDLINE += (98, 97, 326, 327, 129, 358, 49, 279, 48, 278, 64, 294)
_GAPS = (*LIP_GAP, *RIGHT_LID_GAP, *LEFT_LID_GAP)


@dataclass(frozen=True)
class HeadFit:
    """A head model placed before a camera.

    state: where and what the model is; identity and expression rounded to float32.
    vertices: (V, 3) float32, world frame (scene/camera.py), cm: the model's, with lips and lids
        drawn to their landmarks, out of the eyeballs, and sealed.
    landmarks: (478, 2) pixels, the detected ones without the landmarker's mean error.
    landmark_residual: mean distance between them and the model, in eye distances, before lips and
        lids are drawn to them.
    """

    state: State
    vertices: np.ndarray
    landmarks: np.ndarray
    landmark_residual: float


class LandmarkProblem:
    """Residuals of the landmarks the model carries, and one Gauss-Newton step on them.

    landmarks: (478, 3), pixels of `camera`'s image, z in pixels, near is small. bias: of the
    landmarks, what is shipped if None. image: (S, S, 3) linear sRGB, that landmarks in the dark may
    be trusted less. outline: of the head in the photo, which the fit then follows, too. The
    landmarker's expression scores are not used: started from them or pulled towards them, the fit's
    normals were no better or worse (docs/head-model-format.md). Raises FaceError when the landmarks
    are not finite or no head in front of the camera fits.
    """

    def __init__(
        self,
        model: HeadModel,
        landmarks: np.ndarray,
        camera: Camera,
        settings: LandmarkFit,
        bias: LandmarkError | None = None,
        image: np.ndarray | None = None,
        outline: Outline | None = None,
    ) -> None:
        self.bias = bias or shipped_error()
        landmarks = np.asarray(landmarks, dtype=np.float64)
        if landmarks.shape != (LANDMARKS, 3) or not np.isfinite(landmarks).all():
            raise FaceError("the face's landmarks are not 478 finite points: use another photo")
        self.model, self.camera, self.settings = model, camera, settings
        self.outline = outline
        self.used = np.flatnonzero(model.landmark_points.triangle >= 0)
        if len(self.used) < 20:
            raise FaceError(f"the head model {model.name} carries too few landmarks to be fitted")
        self.landmarks = landmarks
        self.goal = landmarks[self.used, :2]
        self.pixel = camera.height / STATED_RESOLUTION
        corners = model.triangles[model.landmark_points.triangle[self.used]]
        weights = model.landmark_points.barycentric[self.used]

        self.neutral = carried(model.neutral[None], corners, weights)[0]  # (L, 3)
        self.basis = carried(model.basis, corners, weights)
        self.frames, self.weights = self._trust()
        #: Factors (478,) on the landmarks' weights for the light on them, and the share that is
        #: left of the weights together.
        self.light, self.lit_share = np.ones(LANDMARKS), 1.0
        if image is not None:
            whole = self.weights.sum()
            self.light[self.used] = self._light_weight(image)
            self.weights = self.weights * self.light[self.used, None]
            self.lit_share = float(self.weights.sum() / whole)
        place = {int(landmark): index for index, landmark in enumerate(self.used)}
        gaps = [pair for pair in _GAPS if pair[0] in place and pair[1] in place]
        self.gaps = np.array([[place[a], place[b]] for a, b in gaps], dtype=int).reshape(-1, 2)

    def _trust(self) -> tuple[np.ndarray, np.ndarray]:
        """Per landmark an orthonormal frame (L, 2, 2), rows the directions, and weights (L, 2)."""
        settings = self.settings
        frames = np.tile(np.eye(2), (LANDMARKS, 1, 1))
        weights = np.full((LANDMARKS, 2), settings.other_weight)
        for contour in (LIPS_OUTER, LIPS_INNER, RIGHT_EYE, LEFT_EYE, NOSE_AND_MIDLINE):
            weights[list(contour)] = settings.contour_weight
        oval = list(FACE_OVAL)
        along = tangents(self.landmarks[oval, :2])
        frames[oval] = np.stack([along, along[:, ::-1] * (-1, 1)], axis=1)
        weights[oval] = settings.oval_weight * np.array([settings.oval_tangential**2, 1.0])
        return frames[self.used], weights[self.used]

    def _light_weight(self, image: np.ndarray) -> np.ndarray:
        """Factors (L,) on the weights of landmarks, for the light on them in the photo.

        Judged by brightness alone: brows, beards and eyes count as darker than they are lit.
        """
        settings = self.settings
        grey = ndimage.gaussian_filter(image.mean(axis=2), settings.light_blur * self.pixel)
        place = self.goal[:, ::-1].T - 0.5
        light = ndimage.map_coordinates(grey, place, order=1, mode="nearest")
        light = np.maximum(light / max(np.percentile(light, 90), 1e-6), 1e-6)
        low, high = np.log(settings.dim)
        part = np.clip((np.log(light) - low) / (high - low), 0, 1)
        return settings.dark_weight + (1 - settings.dark_weight) * part**2 * (3 - 2 * part)

    def start(self) -> State:
        """Scaled rigid alignment of the neutral's landmarks with the detected ones."""
        weight = self.weights.mean(axis=1)
        weight = np.maximum(weight, 0.1 * weight.max())
        weight /= weight.sum()
        seen = self.landmarks[self.used] * (1, -1, -1)
        scale, rotation, _ = procrustes(self.neutral, seen, weight)
        depth = self.camera.focal / max(scale, 1e-6)
        middle = self.camera.unproject((weight @ seen)[:2] * (1, -1), depth)
        units = len(self.model.identity)
        return State(
            rotation,
            middle - rotation @ (weight @ self.neutral),
            np.zeros(units),
            np.zeros(len(self.basis) - units),
        )

    def solve(self, mouth_closed: bool = False) -> HeadFit:
        """The pose by itself, then everything together. Raises FaceError.

        mouth_closed: the photo shows no opening between the lips, whatever the landmarks say; they
        take the edge of a two-toned lip for one.
        """
        state = self.start()
        for free in (slice(6), slice(None)):
            for _ in range(self.settings.iterations):
                state = self.step(state, free)
        return self.fit(state, mouth_closed)

    def step(self, state: State, free: slice, deviation: float | None = None) -> State:
        """One Gauss-Newton step of the unknowns `free` on landmarks, outline and the prior.

        deviation: as for `equations`.
        """
        matrix, gradient, _ = self.equations(state, deviation)
        prior, current, low, high = self.prior(state)
        matrix[np.diag_indices(len(matrix))] += prior
        move = np.zeros(len(matrix))
        move[free] = bounded_solve(
            matrix[free, free], -(gradient + prior * current)[free], low[free], high[free]
        )
        return state.moved(move)

    def turned(self, state: State, share: float) -> State:
        """`state` with its yaw times `share`, the middle of the landmarks where it was."""
        middle = self.neutral.mean(axis=0)
        yaw = _angles(state.rotation, state.rotation @ middle + state.translation)[1]
        turn = state.rotation @ Rotation.from_euler("y", (share - 1) * yaw).as_matrix()
        shift = (state.rotation - turn) @ middle
        return replace(state, rotation=turn, translation=state.translation + shift)

    def prior(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of the unknowns of a step: the prior's precision, the present value, and bounds."""
        units, count = len(state.identity), 6 + len(self.basis)
        precision, current = np.zeros(count), np.zeros(count)
        precision[6 : 6 + units] = 1
        precision[6 + units :] = 1 / self.settings.expression_deviation**2
        current[6:] = np.concatenate([state.identity, state.expression])
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        low[6 + units :], high[6 + units :] = -state.expression, 1 - state.expression
        return precision, current, low, high

    def equations(
        self, state: State, deviation: float | None = None
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Gauss-Newton matrix and gradient of the cost in a step's unknowns, and the cost: of the
        landmarks, and of the outline where there is one.

        deviation: of one landmark coordinate, pixels at 512; the settings' if not given.
        """
        settings, camera = self.settings, self.camera
        deviation = deviation or settings.deviation
        shape = np.concatenate([state.identity, state.expression])
        local = self.neutral + np.tensordot(shape, self.basis, axes=1)
        world = state.placed(local)
        error = camera.project(world) - self.goal + self._expected(state.rotation, world)
        jacobian = camera_motion(camera, world, state.motion(local, self.basis))

        distance = np.linalg.norm(error, axis=-1)
        huber = np.minimum(1, settings.huber * self.pixel / np.maximum(distance, 1e-9))
        weight = self.weights * huber[:, None] / (deviation * self.pixel) ** 2
        across = jacobian[self.gaps[:, 0]] - jacobian[self.gaps[:, 1]]
        gap_error = error[self.gaps[:, 0]] - error[self.gaps[:, 1]]
        jacobian = np.einsum("lij,ljk->lik", self.frames, jacobian)
        error = np.einsum("lij,lj->li", self.frames, error)
        rows = jacobian.reshape(-1, jacobian.shape[2])
        matrix = (rows * weight.reshape(-1, 1)).T @ rows
        gradient = rows.T @ (weight * error).ravel()
        cost = 0.5 * np.sum(weight * (2 - huber)[:, None] * error**2)
        # The gaps say nothing about the pose.
        rows = across.reshape(-1, across.shape[2])[:, 6:]
        gap_weight = 1 / (settings.gap_deviation * self.pixel) ** 2
        matrix[6:, 6:] += gap_weight * rows.T @ rows
        gradient[6:] += gap_weight * rows.T @ gap_error.ravel()
        cost += 0.5 * gap_weight * np.sum(gap_error**2)
        if self.outline is not None:
            of_outline = self.outline.equations(state)
            matrix, gradient = matrix + of_outline[0], gradient + of_outline[1]
            cost += of_outline[2]
        return matrix, gradient, float(cost)

    def _expected(self, rotation: np.ndarray, world: np.ndarray) -> np.ndarray:
        """Mean error (L, 2), pixels, of the landmarks of a head turned by `rotation`, at `world`.

        Its change with the pose is left out of the Jacobian: it moves little within a step.
        """
        middle = world.mean(axis=0)
        roll, yaw, pitch = _angles(rotation, middle)
        cos, sin = np.cos(roll), np.sin(roll)
        upright = self.bias.expected(yaw, pitch)[self.used]
        return upright @ np.array([[cos, -sin], [sin, cos]]) * self.camera.focal / -middle[2]

    def fit(self, state: State, mouth_closed: bool) -> HeadFit:
        """The head at `state`: expression settled, lips and lids at their landmarks, lids outside
        the eyeballs, closed lips sealed.

        Raises FaceError when it is not in front of the camera.
        """
        if not (np.isfinite(state.translation).all() and state.translation[2] < -5):
            raise FaceError("no head fits the landmarks: use a photo that shows more of the face")
        expression = slice(6 + len(state.identity), None)
        for _ in range(self.settings.iterations):
            state = self.step(state, expression, self.settings.last_deviation)
        shape = self.model.vertices(state.identity, state.expression)
        modelled = self.posed(state, shape)
        shape = registered(
            *(self.model, self.camera, state, shape, modelled.landmarks, self.light),
            self.settings.registration,
        )
        shape = lids_outside_eyes(self.model, shape)
        middle, corners = LIP_GAP[1:6], (LIPS_INNER[0], LIPS_INNER[10])
        gap = relative_gap(self.landmarks[:, :2], middle, corners)
        if mouth_closed or gap < self.settings.closed:
            shape = seal_lips(self.model.landmarks(shape), shape)
        return replace(self.posed(state, shape), landmark_residual=modelled.landmark_residual)

    def posed(self, state: State, shape: np.ndarray) -> HeadFit:
        """`shape` (V, 3), in the model's frame, in the pose of `state`, as a fit."""
        vertices = state.placed(shape)
        world = self.model.landmarks(vertices)[self.used]
        landmarks = self.landmarks[:, :2].copy()
        landmarks[self.used] -= self._expected(state.rotation, world)
        eyes = [landmarks[list(eye)].mean(axis=0) for eye in (RIGHT_EYE, LEFT_EYE)]
        distance = np.linalg.norm(self.camera.project(world) - landmarks[self.used], axis=-1)
        identity, expression = (x.astype(np.float32) for x in (state.identity, state.expression))
        return HeadFit(
            replace(state, identity=identity, expression=expression),
            vertices.astype(np.float32),
            landmarks.astype(np.float32),
            float(distance.mean() / max(np.linalg.norm(eyes[0] - eyes[1]), 1e-6)),
        )


def _angles(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Roll, yaw and pitch, radians, of a head at `place` (3,) seen along the ray to it."""
    ray = place / np.linalg.norm(place)
    across = np.cross(ray, (0, 0, -1))
    size = np.linalg.norm(across)
    turn = Rotation.from_rotvec(across * (np.arctan2(size, -ray[2]) / max(size, 1e-9)))
    return (turn * Rotation.from_matrix(rotation)).as_euler("ZYX")


def bounded_solve(
    matrix: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """x within [low, high] that lowers x A x / 2 - b x; A positive definite.

    Not the minimum: what meets a bound stays there, which for one step of many is as good.
    """
    fixed = np.zeros(len(right), dtype=bool)
    solution = np.zeros_like(right)
    for _ in range(10):
        free = ~fixed
        rest = right[free] - matrix[np.ix_(free, fixed)] @ solution[fixed]
        solution[free] = np.linalg.solve(matrix[np.ix_(free, free)], rest)
        outside = (solution < low) | (solution > high)
        solution = np.clip(solution, low, high)
        if not outside.any():
            break
        fixed |= outside
    return solution
