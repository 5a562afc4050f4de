"""How far the features of a mesh lie beside the true ones, and the halos that they leave in albedo.

Where the strongest edges of the true normals lie in the found ones is searched by matching the two
maps of normals around each pixel. Lengths are pixels of a crop of 512.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from unlit.perception.topology import LEFT_EYE, LIPS_OUTER, RIGHT_EYE

#: By name, landmarks along a feature; lines, not closed.
LINES = {
    "nose": ((129, 98, 97, 2, 326, 327, 358), (129, 209, 198), (358, 429, 420)),
    "mouth": ((61, 78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308, 291),),
    "lips": ((*LIPS_OUTER, LIPS_OUTER[0]),),
    "lids": ((*RIGHT_EYE, RIGHT_EYE[0]), (*LEFT_EYE, LEFT_EYE[0])),
    "jaw": (
        *((234, 93, 132, 58, 172, 136, 150, 149, 176, 148),),
        *((152, 377, 400, 378, 379, 365, 397, 288, 361, 323, 454),),
    ),
}
#: Share of the pixels that are edges, how far from a line its pixels are, how far it is searched.
EDGES, NEAR, REACH = 0.15, 6.0, 16.0
_WINDOW = 3.0  # standard deviation of what is matched around a pixel
_LARGEST = 0.25  # squared difference of normals beyond which they are merely different
_STILL = 2e-5  # cost of a displacement, per squared pixel: along an edge nothing tells one


def near(landmarks: np.ndarray, size: int) -> dict[str, np.ndarray]:
    """(S, S) bool by name of LINES: the pixels near it; landmarks: (478, 2), pixels."""
    found = {}
    for name, lines in LINES.items():
        image = np.ones((size, size), np.uint8)
        for line in lines:
            points = np.round(landmarks[list(line)] - 0.5).astype(np.int32)
            cv2.polylines(image, [points], False, 0)
        found[name] = cv2.distanceTransform(image, cv2.DIST_L2, 5) <= NEAR * size / 512
    return found


def distances(
    true: np.ndarray, found: np.ndarray, mask: np.ndarray, landmarks: np.ndarray
) -> dict[str, np.ndarray]:
    """By name of LINES, and `all`: how far each edge pixel near it is displaced across the edge.

    true, found: normals (S, S, 3), 0 where there is none. mask: (S, S) bool, where edges count.
    """
    size = len(true)
    _, gradient = _slopes(cv2.GaussianBlur(true.astype(np.float32), (0, 0), 1.0))
    steep = np.sqrt(gradient[..., 0, 0] + gradient[..., 1, 1])
    edge = mask & (steep >= np.quantile(steep[mask], 1 - EDGES))
    # The direction in which the normals change most: the larger eigenvector.
    angle = 0.5 * np.arctan2(2 * gradient[..., 0, 1], gradient[..., 0, 0] - gradient[..., 1, 1])
    moved = displacement(true, found)
    across = np.abs(moved[..., 0] * np.cos(angle) + moved[..., 1] * np.sin(angle)) * 512 / size
    zones = near(landmarks, size) | {"all": np.ones((size, size), bool)}
    return {name: across[edge & zone] for name, zone in zones.items()}


def displacement(true: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(S, S, 2): x and y, pixels, from each pixel of `true` to where `found` looks most like it."""
    size = len(true)
    unit = size / 512
    reach = round(REACH * unit)
    wide = np.pad(found, ((reach, reach), (reach, reach), (0, 0)))
    least, coarse = np.full((size, size), np.inf), np.zeros((size, size, 2), int)
    for y, x in itertools.product(range(-reach, reach + 1), repeat=2):
        there = wide[reach + y : reach + y + size, reach + x : reach + x + size]
        difference = np.minimum(np.sum((there - true) ** 2, axis=-1), _LARGEST)
        matched = cv2.GaussianBlur(difference.astype(np.float32), (0, 0), _WINDOW * unit)
        cost = matched + _STILL * (x * x + y * y) / unit**2
        nearer = cost < least
        least[nearer], coarse[nearer] = cost[nearer], (x, y)
    return coarse + _rest(true, found, coarse, _WINDOW * unit)


def _rest(true: np.ndarray, found: np.ndarray, coarse: np.ndarray, window: float) -> np.ndarray:
    """(S, S, 2): what whole pixels leave of the displacement (Lucas and Kanade 1981)."""
    ys, xs = np.indices(coarse.shape[:2])
    last = len(true) - 1
    there = found[np.clip(ys + coarse[..., 1], 0, last), np.clip(xs + coarse[..., 0], 0, last)]
    slopes, tensor = _slopes(true)
    pull = np.einsum("yxci,yxc->yxi", slopes, there - true)
    both = np.concatenate([tensor.reshape(*ys.shape, 4), pull], axis=-1).astype(np.float32)
    both = cv2.GaussianBlur(both, (0, 0), window)
    tensor = both[..., :4].reshape(*ys.shape, 2, 2) + 1e-4 * np.eye(2)
    move = -np.linalg.solve(tensor, both[..., 4:, None])[..., 0]
    return np.clip(move, -0.75, 0.75)


def halo(error: np.ndarray, mask: np.ndarray, landmarks: np.ndarray) -> float:
    """Mean of an albedo's error (S, S) near the lines over its mean elsewhere in the mask."""
    beside = np.any(list(near(landmarks, len(error)).values()), axis=0)
    return float(error[mask & beside].mean() / max(float(error[mask & ~beside].mean()), 1e-9))


def _slopes(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (S, S, C, 2) of (S, S, C), x first, and their structure tensor (S, S, 2, 2)."""
    by_x, by_y = np.gradient(image, axis=(1, 0))
    slopes = np.stack([by_x, by_y], axis=-1)
    return slopes, np.einsum("yxci,yxcj->yxij", slopes, slopes)
