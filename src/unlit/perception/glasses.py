"""Frames of glasses: dark lines around the eyes that meet on the bridge of the nose.

Nothing on a bare face crosses the bridge between the eyes as a dark line, so one that does tells
glasses from wrinkles, lids and shadows; the frames are what hangs together with it. Light,
transparent or missing frames are not found; skin seen through the lenses counts as skin.
"""

from __future__ import annotations

import cv2
import numpy as np

from .measures import dark_lines, disk, face_size, feather, filled, log_luminance, upwards
from .topology import BRIDGE_LINES, LEFT_EYE, LEFT_EYEBROW, RIGHT_EYE, RIGHT_EYEBROW

# Depths of dark lines in log-luminance. Measured across the bridge: 2.6 with glasses, up to 0.3
# without.
_BRIDGE = 0.8
_FRAME_SHARE = 0.28  # of the bridge's depth: frames are of one colour, wrinkles fainter


def glasses_frames(image: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Soft mask (S, S) float32 of the frames of glasses; zero where none are worn.

    image: (S, S, 3) linear sRGB. landmarks: (478, 2) pixels.
    """
    resolution = image.shape[0]
    size = face_size(landmarks)
    lines = dark_lines(log_luminance(image), size)
    bridge = [_strongest(lines, landmarks[list(line)]) for line in BRIDGE_LINES]
    depth = min(strength for strength, _ in bridge)
    if depth < _BRIDGE:
        return np.zeros((resolution, resolution), np.float32)
    eyes = filled(landmarks, resolution, RIGHT_EYE, LEFT_EYE).astype(np.uint8)
    brows = filled(landmarks, resolution, RIGHT_EYEBROW, LEFT_EYEBROW)
    lashes = cv2.dilate(eyes, disk(0.012 * size)) > 0
    # From the brows to the nostrils, as wide as the photo: the arms run towards the ears.
    up = upwards(landmarks)
    rows, columns = np.indices(lines.shape) + 0.5
    height = columns * up[0] + rows * up[1]
    band = (height > landmarks[4] @ up) & (height < landmarks[151] @ up)
    # Rims run through brows and lashes, which are left out only after the frames are followed.
    dark = (lines > _FRAME_SHARE * depth) & band & (eyes == 0)
    _, parts = cv2.connectedComponents(dark.astype(np.uint8), connectivity=8)
    touched = {int(parts[tuple(place)]) for _, place in bridge} - {0}
    frames = np.isin(parts, sorted(touched)) & ~lashes & ~brows
    frames = cv2.dilate(frames.astype(np.uint8), disk(0.004 * size))
    return feather(frames.astype(np.float32), size / 300)


def _strongest(lines: np.ndarray, path: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest value along a polyline (N, 2) and its (row, column)."""
    steps = np.linspace(0, len(path) - 1, 20 * len(path))
    points = np.stack([np.interp(steps, np.arange(len(path)), path[:, k]) for k in (1, 0)], axis=1)
    places = np.clip(points.astype(int), 0, lines.shape[0] - 1)
    values = lines[places[:, 0], places[:, 1]]
    return float(values.max()), places[int(values.argmax())]
