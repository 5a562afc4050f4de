"""Which glasses cover a face, told from the parser's shares."""

from __future__ import annotations

import numpy as np

from .parser import CLASSES, CONTOURS, SIZE, contours
from .topology import FACE_OVAL, LEFT_EYE, RIGHT_EYE

#: The share of its place from which something counts as there; see `covers`. On the 21 photos of
#: the lab notes frames have .04 to .09 where some are worn and up to .02 where none are.
LEAST = {"glasses": 0.03, "tinted glasses": 0.4}
#: The class that tells each.
TOLD_BY = {"glasses": "frame", "tinted glasses": "tinted lens"}


def covers(shares: np.ndarray, landmarks: np.ndarray) -> dict[str, float]:
    """Of each of LEAST, how much of its place it takes, 0 to 1.

    shares: (192, 192, 13), what `parse` says. landmarks: (478, 2), on its grid, pixels. Glasses:
    their frames, of the face's oval; tinted glasses: their lenses, of the eyes.
    """
    drawn = dict(zip(CONTOURS, contours(landmarks, SIZE), strict=True))
    places = {"glasses": drawn[(FACE_OVAL,)], "tinted glasses": drawn[(RIGHT_EYE, LEFT_EYE)]}
    return {
        name: float((shares[..., CLASSES.index(TOLD_BY[name])] * where).sum())
        / max(float(where.sum()), 1.0)
        for name, where in places.items()
    }


def worn(shares: np.ndarray, landmarks: np.ndarray, size: int) -> list[str]:
    """Which of LEAST the face wears.

    shares: (192, 192, 13), what `parse` says of a crop of `size` pixels a side. landmarks:
    (478, 2), pixels of that crop.
    """
    found = covers(shares, landmarks * (len(shares) / size))
    return [name for name, share in found.items() if share >= LEAST[name]]
