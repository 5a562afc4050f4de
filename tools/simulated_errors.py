"""Learn the landmarker's mean error from photos of heads whose landmarks are known.

    python tools/simulated_errors.py [HEADS]      writes src/unlit/head/landmark_error.npz

Three photos each of HEADS random heads of the default model: identity from its prior, every other
head with an expression, yaw to 42 degrees, pitch and roll to 15, 60 to 150 cm away, skin painted
light to dark, light from an even sky to one lamp anywhere in front. 2 to 3 s a head.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from painting import SKINS, Features, Subject, paint

from unlit.color import encode_srgb
from unlit.head.contact import eyeballs
from unlit.head.landmark_error import FILE, LandmarkError, terms
from unlit.head.model import LANDMARKS, HeadModel
from unlit.head.sources.library import default_model
from unlit.perception.landmarks import find_faces
from unlit.perception.topology import LEFT_EYEBROW, LIPS_INNER, LIPS_OUTER, RIGHT_EYEBROW
from unlit.scene.camera import Camera
from unlit.scene.light import disc, uniform

_HEADS = 180
_PHOTOS = 3
_SIZE = 256
_SAMPLES = 16
#: Degrees.
_YAW, _PITCH, _ROLL = 42.0, 15.0, 15.0
_EXPRESSIVE = 0.6
_RIDGE = 1.0
_MOUTH, _UPPER = ("mouth", "jaw"), ("brow", "cheek", "nose", "eyeSquint", "eyeBlink", "eyeWide")


@dataclass(frozen=True)
class Example:
    """One photo: error (478, 2) as in head/landmark_error.py, yaw and pitch in radians."""

    error: np.ndarray
    yaw: float
    pitch: float


def examples(model: HeadModel, seed: int) -> Iterator[Example]:
    """The photos of one random head in which the landmarker finds a face."""
    rng = np.random.default_rng([7, seed])
    identity = rng.standard_normal(len(model.identity)).astype(np.float32)
    shape = model.vertices(identity, _expression(model, rng))
    yaw, pitch, roll = rng.uniform(-1, 1, 3) * np.radians((_YAW, _PITCH, _ROLL))
    turn = Rotation.from_euler("ZYX", (roll, yaw, pitch)).as_matrix()
    distance, width = rng.uniform(60, 150), rng.uniform(22, 32)
    middle = np.nanmean(model.landmarks(shape), axis=0)
    place = (*rng.uniform(-1.5, 1.5, 2), -distance)
    vertices = ((shape - middle) @ turn.T + place).astype(np.float32)
    camera = Camera(_SIZE, _SIZE, _SIZE * distance / width, _SIZE / 2, _SIZE / 2)
    true = camera.project(np.nan_to_num(model.landmarks(vertices), nan=-1.0))
    subject = _painted(model, vertices, camera, true, rng, seed)
    for photo in range(_PHOTOS):
        image = subject.photograph(_light(rng), _SAMPLES, _PHOTOS * seed + photo)
        bright = image.max(axis=2, keepdims=True)
        image = image * (0.8 / max(float(np.percentile(bright[bright > 0], 97)), 1e-6))
        image = image + rng.uniform(0, 0.3) * (bright <= 0)  # a plain wall behind
        faces = find_faces(np.rint(255 * np.clip(encode_srgb(image), 0, 1)).astype(np.uint8))
        if faces:
            moved = (faces[0].landmarks[:, :2] - true) * (distance / camera.focal)
            cos, sin = np.cos(roll), np.sin(roll)
            error = moved @ np.array([[cos, sin], [-sin, cos]])
            error[model.landmark_points.triangle < 0] = 0
            yield Example(error, yaw, pitch)


def _expression(model: HeadModel, rng: np.random.Generator) -> np.ndarray:
    """Two units of the mouth and two of the rest, each on both sides; or none."""
    strengths = np.zeros(len(model.expression), np.float32)
    if rng.random() < _EXPRESSIVE:
        for parts, most in ((_MOUTH, 0.5), (_UPPER, 0.7)):
            names = [name for name in model.expression_names if name.startswith(parts)]
            for name in rng.choice(names, 2, replace=False):
                stem = str(name).removesuffix("Left").removesuffix("Right")
                strength = rng.uniform(0, most)
                for side in (stem, f"{stem}Left", f"{stem}Right"):
                    if side in names and (stem != "mouth" or side == name):
                        strengths[model.expression_names.index(side)] = strength
    return strengths


def _light(rng: np.random.Generator) -> np.ndarray:
    """A lamp somewhere in front and some even light, seldom much of it."""
    even = rng.uniform(0.5, 1) if rng.random() < 0.3 else rng.uniform(0, 0.25)
    azimuth, height = np.radians((rng.uniform(-100, 100), rng.uniform(-10, 50)))
    direction = (np.sin(azimuth) * np.cos(height), np.sin(height), np.cos(azimuth) * np.cos(height))
    lamp = disc(direction, half_angle=float(rng.choice([2.5, 8.0, 20.0])))
    return (even * uniform() + (1 - even) * lamp).astype(np.float32)


def _painted(
    model: HeadModel,
    vertices: np.ndarray,
    camera: Camera,
    landmarks: np.ndarray,
    rng: np.random.Generator,
    seed: int,
) -> Subject:
    eyes = np.any(eyeballs(model), axis=0)
    brows = (landmarks[list(RIGHT_EYEBROW[:5])], landmarks[list(LEFT_EYEBROW[:5])])
    features = Features(landmarks[list(LIPS_OUTER)], brows, eyes)
    skin = str(rng.choice(list(SKINS)))
    freckles, lipstick = int(rng.integers(0, 150)), bool(rng.random() < 0.15)
    maps = paint(vertices, model.triangles, camera, features, skin, seed, freckles, lipstick)
    mask = np.ones((camera.height, camera.width), dtype=bool)
    return Subject("simulated", vertices, model.triangles, camera, maps, mask)


def partners(model: HeadModel) -> np.ndarray:
    """(478,) the landmark on the other side of a symmetric neutral; itself where there is none."""
    points = model.landmarks(model.neutral)
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    apart = np.linalg.norm(points[known][:, None] - (points[known] * (-1, 1, 1))[None], axis=-1)
    result = np.arange(LANDMARKS)
    result[known] = known[linear_sum_assignment(apart)[1]]
    # Upper and lower points of closed lips lie too close together for the assignment.
    for row in (LIPS_INNER[:11], LIPS_INNER[11:]):
        result[list(row)] = row[::-1]
    return result


def learn(
    errors: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, mirror: np.ndarray
) -> LandmarkError:
    """The error's mean from N examples, by least squares with a little damping.

    errors: (N, 478, 2) detected minus true, cm, roll undone. yaw, pitch: (N,) radians.
    mirror: (478,) each point's partner: a mirrored photo is an example, too.
    """
    errors = np.concatenate([errors, errors[:, mirror] * (-1, 1)])
    flat = errors.reshape(len(errors), -1)
    rows = terms(np.concatenate([yaw, -yaw]), np.concatenate([pitch, pitch]))
    size = np.maximum(rows.std(axis=0), 1e-9)
    size[0] = 1
    scaled = rows / size
    ridge = np.diag([0.0, *np.full(rows.shape[1] - 1, _RIDGE)])
    return LandmarkError(
        np.linalg.solve(scaled.T @ scaled + ridge, scaled.T @ flat) / size[:, None]
    )


def main(heads: int = _HEADS) -> None:
    """Make the error that is shipped."""
    model = default_model()
    found: list[Example] = []
    for seed in range(heads):
        found += examples(model, seed)
        print(f"{seed + 1} of {heads} heads", end="\r", file=sys.stderr, flush=True)
    error = learn(
        np.array([x.error for x in found]),
        np.array([x.yaw for x in found]),
        np.array([x.pitch for x in found]),
        partners(model),
    )
    np.savez_compressed(FILE, mean=error.mean.astype(np.float16))
    print(f"{FILE}: {len(found)} photos of {heads} heads")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
