"""Subjects shaped by the ICT-FaceKit model of the shared test data.

The default head model has never seen these shapes. Units, axes and vertex ranges are those of
the packed file (see the shared data's SOURCES.md).
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from painting import Features, Subject, paint
from scipy.spatial.transform import Rotation

from unlit.scene.camera import Camera

# Vertex ranges: everything up to the teeth is opaque head; then two eyeballs; then see-through
# parts (tear fluid, lashes) that are left out.
_EYES = slice(21451, 24591)
_USED = 24591


def ict_subject(
    shared: Path,
    skin: str,
    seed: int,
    size: int = 512,
    yaw: float = 0.0,
    freckles: int = 150,
    lipstick: bool = False,
    deviation: float = 0.8,
    expression: dict[str, float] | None = None,
) -> Subject:
    """A random ICT identity (`deviation` standard deviations per component), painted.

    The crop's camera stands 90 cm away; `yaw` turns the head, degrees. expression: strengths of
    the model's units by name, as in {"mouthSmile_L": 0.6}.
    """
    with np.load(shared / "data/models/ict_facekit/ict_facekit.npz", allow_pickle=False) as data:
        rng = np.random.default_rng(seed)
        weights = rng.standard_normal(40) * deviation * np.linspace(1, 0.6, 40)
        shape = data["neutral"].astype(np.float32)
        shape = shape + np.tensordot(weights.astype(np.float32), data["identity"][:40], axes=1)
        units = list(data["expression_names"])
        for name, strength in (expression or {}).items():
            shape = shape + strength * data["expression"][units.index(name)].astype(np.float32)
        triangles = data["triangles"].astype(np.int32)
        landmarks = data["landmarks_multipie68"].astype(int)
    triangles = triangles[(triangles < _USED).all(axis=1)]
    centre = shape[landmarks].mean(axis=0) + np.array([0, 1.5, -3])
    turn = Rotation.from_euler("yx", [yaw, 3.0], degrees=True).as_matrix()
    vertices = ((shape - centre) @ turn.T + (0, 0, -90)).astype(np.float32)[:_USED]
    camera = Camera(size, size, 90 * size / 26.0, size / 2, size / 2)
    seen = camera.project(vertices[landmarks]) * 1.0
    eyes = np.zeros(_USED, dtype=bool)
    eyes[_EYES] = True
    lips = np.concatenate([seen[48:60]])
    features = Features(lips, (seen[17:22], seen[22:27]), eyes)
    maps = paint(
        vertices,
        triangles,
        camera,
        features,
        skin,
        seed,
        freckles=freckles,
        lipstick=lipstick,
    )
    raised = np.array([0, 30 * size / 512])
    oval = np.concatenate([seen[0:17], seen[26:21:-1] - raised, seen[21:16:-1] - raised])
    mask = np.zeros((size, size), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(oval).astype(np.int32)], 1)
    mask = cv2.erode(mask, np.ones((5, 5), np.uint8)) > 0
    return Subject(f"ict-{skin}-{seed}", vertices, triangles, camera, maps, mask)
