"""ICT-FaceKit as a head model: from its public OBJ files to the format of model.py.

ICT-FaceKit (USC ICT Vision and Graphics Lab, MIT licence, github.com/ICT-VGL/ICT-FaceKit) is a
neutral head, 100 principal components of light-stage scans, one OBJ each at one standard deviation,
and facial actions, one OBJ each at full strength, all on one topology: vertices of the same number
are the same point. The tables below are those of its README.

Teeth, tongue, lashes and the see-through parts of the eyes are left out; the shell with the cornea
is the eyeball. What the repository does not say is taken from another head, aligned by named
points: which vertices are scalp, neck and ears. The landmarks are found as embedding.py does, lips
and eyebrows from their outlines.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from skimage.measure import points_in_poly

from ...errors import ModelError, SubjectError
from ...perception.topology import MULTI_PIE_LANDMARKS
from ...progress.callbacks import StepProgress
from ...scene.surface_points import SurfacePoints
from ...storage.meshes import Surface, read_mesh
from ..embedding import embed_landmarks
from ..eyebrows import eyebrow_vertices
from ..model import LANDMARKS, VERTEX_REGIONS, HeadModel
from ..procrustes import procrustes

NEUTRAL = "generic_neutral_mesh.obj"
_INDICES = "vertex_indices.json"
_FOLDER = "FaceXModel"
_VERTICES = 26_719
_IDENTITIES = 100
# The parts that are kept, as ranges of vertices, and the region of each.
_PARTS = (
    (0, 11_248, "skin"),  # face, head and neck
    (11_248, 13_294, "mouth"),
    (13_294, 14_062, "eyes"),  # sockets
    (21_451, 22_221, "eyes"),  # left eyeball; its inner iris follows and is left out
    (23_021, 23_791, "eyes"),  # right eyeball
)
# The 68 points of Multi-PIE.
MULTI_PIE = (
    *(1225, 1888, 1052, 367, 1719, 1722, 2199, 1447, 966, 3661, 4390, 3927, 3924, 2608, 3272, 4088),
    *(3443, 268, 493, 1914, 2044, 1401, 3615, 4240, 4114, 2734, 2509, 978, 4527, 4942, 4857, 1140),
    *(2075, 1147, 4269, 3360, 1507, 1542, 1537, 1528, 1518, 1511, 3742, 3751, 3756, 3721, 3725),
    *(3732, 5708, 5695, 2081, 0, 4275, 6200, 6213, 6346, 6461, 5518, 5957, 5841, 5702, 5711, 5533),
    *(6216, 6207, 6470, 5517, 5966),
)
# A landmark farther than this from the other head's is none, cm.
_STRAY = 1.5
_BORROWED = ("scalp", "neck", "ears")
_SIDES = {"_L": "Left", "_R": "Right"}


def build(folder: Path, reference: Callable[[], HeadModel], progress: StepProgress) -> HeadModel:
    """The model in `folder`, a copy of the repository or its folder FaceXModel.

    reference: gives a head whose regions and landmarks are known; asked once all files are read.
    progress: called with (what is done now, files read, of all).
    Raises ModelError when it is not one, naming the file that is missing or wrong.
    """
    inner = folder / _FOLDER
    folder = inner if inner.is_dir() else folder
    if not (folder / NEUTRAL).is_file():
        raise ModelError(
            f"{folder}: holds no {NEUTRAL}; give the folder {_FOLDER} of a copy of "
            "github.com/ICT-VGL/ICT-FaceKit"
        )
    neutral = _mesh(folder / NEUTRAL)
    if len(neutral.vertices) != _VERTICES or neutral.uv is None or neutral.triangle_uv is None:
        raise ModelError(
            f"{folder / NEUTRAL}: not ICT-FaceKit's neutral head: it has "
            f"{len(neutral.vertices)} vertices, not {_VERTICES} with texture coordinates"
        )
    names = _expressions(folder)
    shapes = [f"identity{k:03d}" for k in range(_IDENTITIES)] + names
    files = _files(folder, shapes)
    kept = np.concatenate([np.arange(low, high) for low, high, _ in _PARTS])
    region = np.concatenate(
        [np.full(high - low, VERTEX_REGIONS.index(name), np.uint8) for low, high, name in _PARTS]
    )

    moved = np.zeros((len(files), len(kept), 3), dtype=np.float32)
    for index, file in enumerate(files):
        progress(f"reading {file.name}", index, len(files))
        moved[index] = _moved(file, neutral.vertices, kept)

    row = np.full(_VERTICES, -1)
    row[kept] = np.arange(len(kept))
    triangles = row[neutral.triangles]
    whole = (triangles >= 0).all(axis=1)
    corners, triangle_uv = np.unique(neutral.triangle_uv[whole], return_inverse=True)
    progress("finding the landmarks", len(files) - 1, len(files))
    model = HeadModel(
        name="ICT-FaceKit",
        licence="MIT",
        origin="USC ICT Vision and Graphics Lab, github.com/ICT-VGL/ICT-FaceKit",
        neutral=neutral.vertices[kept].astype(np.float32),
        identity=moved[:_IDENTITIES],
        expression=moved[_IDENTITIES:],
        expression_names=tuple(_arkit(name) for name in names),
        triangles=triangles[whole].astype(np.int32),
        uv=neutral.uv[corners].astype(np.float32),
        triangle_uv=triangle_uv.reshape(-1, 3).astype(np.int32),
        landmark_points=SurfacePoints.empty(LANDMARKS),
        vertex_region=region,
    )
    model = _with_landmarks(model, reference())
    progress("ICT-FaceKit read", len(files), len(files))
    return model


def _mesh(path: Path) -> Surface:
    try:
        return read_mesh(path)
    except SubjectError as error:
        raise ModelError(str(error)) from None


def _expressions(folder: Path) -> list[str]:
    """The names in the repository's list of facial actions."""
    path = folder / _INDICES
    try:
        names = json.loads(path.read_text(encoding="utf-8"))["expressions"]
    except FileNotFoundError:
        raise ModelError(f"{path}: missing; copy the whole folder {_FOLDER}") from None
    except (OSError, ValueError, KeyError, TypeError):
        raise ModelError(f"{path}: not ICT-FaceKit's list of facial actions") from None
    # Names of files in this folder, and nothing that leads out of it.
    plain = isinstance(names, list) and all(isinstance(x, str) and x.isidentifier() for x in names)
    if not plain:
        raise ModelError(f"{path}: field 'expressions' is not a list of names")
    return names


def _files(folder: Path, shapes: list[str]) -> list[Path]:
    """The files of these shapes, all of which are there."""
    files = [folder / f"{shape}.obj" for shape in shapes]
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise ModelError(
            f"{folder}: {len(missing)} of {len(files)} shapes are missing, {missing[0]} first; "
            f"copy the whole folder {_FOLDER}"
        )
    return files


def _moved(path: Path, neutral: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Displacement (K, 3), cm, of the kept vertices in the shape `path`."""
    try:
        with path.open("rb") as file:
            lines = [line[2:] for line in file if line.startswith(b"v ")]
        vertices = np.array([line.split()[:3] for line in lines], dtype=np.float64)
    except (OSError, ValueError) as error:
        raise ModelError(f"{path}: not a whole .obj file ({error})") from None
    if vertices.shape != neutral.shape:
        raise ModelError(f"{path}: has {len(vertices)} vertices, the neutral head {len(neutral)}")
    return vertices[kept] - neutral[kept]


def _arkit(name: str) -> str:
    """ICT's name as ARKit writes it; the units that ICT alone splits in two keep both sides."""
    return name[:-2] + _SIDES[name[-2:]] if name[-2:] in _SIDES else name


def _with_landmarks(model: HeadModel, reference: HeadModel) -> HeadModel:
    """`model` with landmarks and the finer regions found on its neutral."""
    neutral, triangles = model.neutral, model.triangles
    skin = model.vertex_region == VERTEX_REGIONS.index("skin")
    region = model.vertex_region.copy()
    aligned = _aligned(neutral, reference)
    region[skin] = _borrowed(aligned[skin], reference)
    front = skin & (neutral[:, 2] > neutral[list(MULTI_PIE[:17]), 2].mean())
    lips = neutral[list(MULTI_PIE[48:60]), :2]  # the ring of the outer lips
    region[front & points_in_poly(neutral[:, :2], lips)] = VERTEX_REGIONS.index("lips")
    found = embed_landmarks(neutral, triangles, region, symmetric=True)
    brows = eyebrow_vertices(found.on(neutral, triangles), neutral)
    region[front & brows] = VERTEX_REGIONS.index("eyebrows")
    found = _without_strays(found, aligned, triangles, reference)
    return replace(model, landmark_points=found, vertex_region=region)


def _aligned(neutral: np.ndarray, head: HeadModel) -> np.ndarray:
    """Vertices (K, 3) in the frame and at the size of `head`."""
    theirs = head.landmarks(head.neutral)[list(MULTI_PIE_LANDMARKS.values())]
    ours = neutral[[MULTI_PIE[point] for point in MULTI_PIE_LANDMARKS]]
    scale, rotation, shift = procrustes(ours, theirs)
    return (scale * neutral @ rotation.T + shift).astype(np.float32)


def _borrowed(aligned: np.ndarray, head: HeadModel) -> np.ndarray:
    """Region (K,) of aligned skin vertices (K, 3): that of `head`, if one of _BORROWED."""
    outside = ~np.isin(head.vertex_region, [VERTEX_REGIONS.index(n) for n in ("eyes", "mouth")])
    region = head.vertex_region[outside][KDTree(head.neutral[outside]).query(aligned)[1]]
    known = np.isin(region, [VERTEX_REGIONS.index(name) for name in _BORROWED])
    return np.where(known, region, VERTEX_REGIONS.index("skin"))


def _without_strays(
    found: SurfacePoints, aligned: np.ndarray, triangles: np.ndarray, head: HeadModel
) -> SurfacePoints:
    """`found` without the points whose rays slipped through an opening of the mesh."""
    apart = found.on(aligned, triangles) - head.landmarks(head.neutral)
    stray = ~(np.linalg.norm(apart, axis=1) < _STRAY)
    return SurfacePoints(
        np.where(stray, np.int32(-1), found.triangle),
        np.where(stray[:, None], np.float32(0), found.barycentric),
    )
