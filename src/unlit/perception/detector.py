"""Face detection: a short-range single-shot detector made to see small and rolled faces.

The network (BlazeFace, Bazarevsky et al. 2019) looks at 128 x 128 pixels and misses faces below
about a sixth of that. So it is run on the whole photo and on overlapping tiles of a half and a
quarter of its longer side; where that leads to no face, on tiles of an eighth, and then on rotated
views.
Detections of all views are merged by weighted non-maximum suppression.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator

import numpy as np

from .networks import DETECTOR, network
from .views import Pyramid, Square

RESOLUTION = 128
MIN_CANDIDATE = 0.5  # what may join a cluster
MIN_SCORE = 0.75  # of its best: faces of 50 px and more score 0.87, false alarms up to 0.74
MIN_OVERLAP = 0.3  # intersection over union from which two detections are one face

_SMALLEST_TILE = 128  # pixels of the photo; enlarging beyond shows the network nothing new
_TURNS = np.radians([-45, 45, -90, 90])


@functools.cache
def anchors() -> np.ndarray:
    """Anchor centres (896, 2) in units of the view: two per cell of a 16 x 16 grid, six per cell
    of an 8 x 8 grid, rows first."""
    grids = []
    for cells, per_cell in ((16, 2), (8, 6)):
        centre = (np.arange(cells) + 0.5) / cells
        ys, xs = np.meshgrid(centre, centre, indexing="ij")
        grids.append(np.stack([xs, ys], axis=-1).reshape(-1, 2).repeat(per_cell, axis=0))
    return np.concatenate(grids)


def detections(pyramid: Pyramid) -> Iterator[list[tuple[Square, float]]]:
    """Candidate faces as (square, score), best first, in three ever more costly searches.

    The next search is made only when the caller asks for it. The square is the detector's box,
    turned with the eye line about its centre, in photo pixels.
    """
    turned = (view for angle in _TURNS for view in _views(pyramid, (1, 2), angle))
    for views in (_views(pyramid, (1, 2, 4), 0.0), _views(pyramid, (8,), 0.0), turned):
        yield [(_square(found), float(found[0])) for found in _merge(_run(pyramid, views))]


def _views(pyramid: Pyramid, divisions: tuple[int, ...], angle: float) -> Iterator[Square]:
    """Squares of the longer side over each of `divisions`, overlapping by half, turned by angle."""
    width, height = pyramid.width, pyramid.height
    longer = max(width, height)
    for division in divisions:
        side = longer / division
        if division > 1 and side < _SMALLEST_TILE:
            return
        for y in _centres(height, side):
            for x in _centres(width, side):
                yield Square(x, y, side, angle)


def _centres(length: float, side: float) -> np.ndarray:
    if side >= length:
        return np.array([length / 2])
    count = int(np.ceil((length - side) / (side / 2) - 1e-9)) + 1
    return np.linspace(side / 2, length - side / 2, count)


def _run(pyramid: Pyramid, views: Iterable[Square]) -> np.ndarray:
    """Candidates (N, 16) of all views: score, box centre (x, y), box side, six keypoints (x, y).

    Keypoints in photo pixels: right eye, left eye, nose tip, mouth, right ear, left ear.
    """
    candidates = [np.zeros((0, 16))]
    for view in views:
        pixels = pyramid.view(view, RESOLUTION).astype(np.float32)
        regressors, logits = network(DETECTOR)(pixels / 127.5 - 1)
        scores = 1 / (1 + np.exp(-np.clip(logits[0, :, 0].astype(np.float64), -100, 100)))
        keep = scores >= MIN_CANDIDATE
        if not keep.any():
            continue
        values = regressors[0, keep].astype(np.float64) / RESOLUTION
        centre = anchors()[keep]
        points = values[:, [0, 1, *range(4, 16)]].reshape(-1, 7, 2) + centre[:, None]
        side = values[:, 2:4].mean(axis=1) * view.side
        placed = view.to_photo(points).reshape(-1, 14)
        candidates.append(np.column_stack([scores[keep], placed[:, :2], side, placed[:, 2:]]))
    return np.concatenate(candidates)


def _merge(candidates: np.ndarray) -> np.ndarray:
    """Weighted non-maximum suppression: each cluster's score-weighted mean, best score first."""
    remaining = candidates[np.argsort(-candidates[:, 0], kind="stable")]
    merged = []
    while len(remaining) and remaining[0, 0] >= MIN_SCORE:
        same = _overlap(remaining[0], remaining) >= MIN_OVERLAP
        same[0] = True
        cluster = remaining[same]
        mean = np.average(cluster, axis=0, weights=cluster[:, 0])
        mean[0] = cluster[0, 0]
        merged.append(mean)
        remaining = remaining[~same]
    return np.array(merged).reshape(-1, candidates.shape[1])


def _overlap(one: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Intersection over union (N,) of axis-aligned square boxes."""
    low = np.maximum(one[1:3] - one[3] / 2, many[:, 1:3] - many[:, 3:4] / 2)
    high = np.minimum(one[1:3] + one[3] / 2, many[:, 1:3] + many[:, 3:4] / 2)
    shared = np.prod(np.maximum(high - low, 0), axis=1)
    return shared / (one[3] ** 2 + many[:, 3] ** 2 - shared)


def _square(candidate: np.ndarray) -> Square:
    right_eye, left_eye = candidate[4:6], candidate[6:8]
    dx, dy = left_eye - right_eye
    return Square(candidate[1], candidate[2], candidate[3], float(np.arctan2(dy, dx)))
