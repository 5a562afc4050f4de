"""The standard subjects of the quality benchmark.

`own-*` are shapes of the default head model, so that they need nothing but unlit itself: the fit
can reach their shape exactly, which flatters it. `ict-*` and the Lee Perry-Smith scan have shapes
it has never seen; they need the licensed test data beside a checkout (../shared).
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from common import DISTANCE, WIDTH
from painting import Features, Subject, paint
from scipy.spatial.transform import Rotation

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
from unlit.evaluate.scan import Scan
from unlit.evaluate.subject_mesh import read_subject
from unlit.evaluate.truth import KnownSubject
from unlit.head.contact import eyeballs
from unlit.head.sources.library import default_model
from unlit.perception.topology import FACE_OVAL, LEFT_EYEBROW, LIPS_OUTER, RIGHT_EYEBROW
from unlit.scene.camera import Camera

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"

#: The Lee Perry-Smith scan (Infinite-Realities, CC BY 3.0). Its traps: the GLB holds v from the
#: bottom up, its unit is 5.5 cm, the gloss map is relative.
LEE_PERRY_SMITH = """\
format = 1
name = "Lee Perry-Smith"
credit = "Infinite, 3D Head Scan by Lee Perry-Smith, CC BY 3.0"
units = 5.5
frontal = true
object_to_world = {pose}

[[mesh]]
file = "{folder}/LeePerrySmith.glb"
v_axis = "up"
diffuse_albedo = {{ file = "{folder}/Map-COL.jpg", encoding = "srgb" }}
specular_albedo = {{ file = "{folder}/Map-SPEC.jpg", encoding = "linear", scale = 1.5 }}
roughness = {{ value = 0.3 }}
normal = {{ file = "{folder}/Infinite-Level_02_Tangent_SmoothUV.jpg", space = "tangent" }}
"""


def own(
    skin: str, seed: int, size: int, yaw: float = 0.0, expression: dict[str, float] | None = None
) -> Subject:
    """A random person of the default head model, painted.

    yaw: of the head, degrees. expression: strengths of the model's units by name.
    """
    model = default_model()
    rng = np.random.default_rng(seed)
    identity = rng.standard_normal(len(model.identity)).astype(np.float32) * 0.7
    strengths = np.zeros(len(model.expression), np.float32)
    for name, strength in (expression or {}).items():
        strengths[model.expression_names.index(name)] = strength
    vertices = model.vertices(identity, strengths)
    middle = np.nanmean(model.landmarks(vertices), axis=0)
    turn = Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    vertices = ((vertices - middle) @ turn.T - (0, 0, DISTANCE)).astype(np.float32)
    camera = Camera(size, size, size * DISTANCE / WIDTH, size / 2, size / 2)
    seen = camera.project(np.nan_to_num(model.landmarks(vertices), nan=-1.0))

    def contour(indices: tuple[int, ...]) -> np.ndarray:
        return seen[list(indices)]

    eyes = np.zeros(len(vertices), dtype=bool)
    for ball in eyeballs(model):
        eyes |= ball
    brows = (contour(RIGHT_EYEBROW[:5]), contour(LEFT_EYEBROW[:5]))
    features = Features(contour(LIPS_OUTER), brows, eyes)
    maps = paint(vertices, model.triangles, camera, features, skin, seed)
    mask = np.zeros((size, size), np.uint8)
    cv2.fillPoly(mask, [np.round(contour(FACE_OVAL)).astype(np.int32)], 1)
    mask = cv2.erode(mask, np.ones((5, 5), np.uint8)) > 0
    return Subject(f"own-{skin}", vertices, model.triangles, camera, maps, mask)


def ict(skin: str, seed: int, size: int, yaw: float = 0.0, **more: Any) -> Subject:
    """A random person of another head model, turned by `yaw` degrees; more: see tests/ict.py."""
    sys.path.insert(0, str(ROOT / "tests"))
    from ict import ict_subject

    return ict_subject(SHARED, skin, seed, size, yaw, **more)


def lee_perry_smith(size: int, yaw: float = 0.0) -> Scan:
    """The scan, its head turned by `yaw` degrees."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    text = LEE_PERRY_SMITH.format(folder=SHARED / "data/scans/lee_perry_smith", pose=pose.tolist())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "subject.toml"
        file.write_text(text)
        return read_subject(file, size)


def standard(size: int) -> dict[str, Callable[[], KnownSubject]]:
    """By name, how to make each subject that this machine can make."""
    found: dict[str, Callable[[], KnownSubject]] = {
        "own-light": lambda: own("light", 11, size),
        "own-dark": lambda: own("dark", 13, size),
    }
    if (SHARED / "data").is_dir():
        found |= {
            "ict-light": lambda: ict("light", 1, size),
            "ict-dark": lambda: ict("dark", 3, size),
            "lee-perry-smith": lambda: lee_perry_smith(size),
        }
    return found
