"""What covers a face: glasses, a beard, hair, a hat, a hand or cloth, told from the shares."""

from __future__ import annotations

import numpy as np

from .measures import above
from .parser import CLASSES, CONTOURS, SIZE, contours
from .topology import FACE_OVAL, LEFT_EYE, LEFT_EYEBROW, NOSE_BASE, RIGHT_EYE, RIGHT_EYEBROW

#: The share of its place from which something counts as there; see `covers`. On the 21 photos of
#: the lab notes, worn and not: glasses .06 and .0015, tinted ones .87 and .00, a full beard .21 and
#: .10, a hat .28 and .09. On rendered heads glasses .013 and more (17 of 20) and .0022 and less, a
#: hat .165 and more (18 of 20) and .001 and less.
LEAST = {
    "glasses": 0.01,
    "tinted glasses": 0.4,
    "beard": 0.15,
    "hair": 0.1,
    "hat": 0.13,
    "hand or cloth": 0.04,
}


def covers(shares: np.ndarray, landmarks: np.ndarray, size: int) -> dict[str, float]:
    """Of each of LEAST, how much of its place it takes.

    shares: (192, 192, 13), what `parse` says of a crop of `size` pixels a side. landmarks:
    (478, 2), pixels of that crop. Glasses (frame and clear lens), a hand or cloth: the sum over
    the face's oval, of its area; tinted glasses: over the eyes; a beard: below the nose; hair:
    above the brows, both within the oval; a hat: cloth above the eyes, of the oval's area.
    """
    landmarks = landmarks * (SIZE / size)
    drawn = dict(zip(CONTOURS, contours(landmarks, SIZE), strict=True))
    oval, eyes = drawn[(FACE_OVAL,)], drawn[(RIGHT_EYE, LEFT_EYE)]
    above_nose, above_brows, above_eyes = (
        above(landmarks, SIZE, *points)
        for points in ((NOSE_BASE,), RIGHT_EYEBROW + LEFT_EYEBROW, RIGHT_EYE + LEFT_EYE)
    )

    def share(where: np.ndarray, *names: str, area: float | None = None) -> float:
        classes = [CLASSES.index(name) for name in names]
        total = float((shares[..., classes].sum(axis=-1) * where).sum())
        return total / max(float(where.sum()) if area is None else area, 1.0)

    return {
        "glasses": share(oval, "frame", "clear lens"),
        "tinted glasses": share(eyes, "tinted lens"),
        "beard": share(oval * ~above_nose, "beard"),
        "hair": share(oval * above_brows, "hair"),
        "hat": share(above_eyes, "cloth", area=float(oval.sum())),
        "hand or cloth": share(oval, "hand", "cloth"),
    }


def worn(shares: np.ndarray, landmarks: np.ndarray, size: int) -> dict[str, float]:
    """Those of `covers` that are there; arguments and values are its."""
    found = covers(shares, landmarks, size)
    return {name: share for name, share in found.items() if share >= LEAST[name]}
