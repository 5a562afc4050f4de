"""What the parser's network learns from: pictures of path-traced heads, each drawn anew.

Every example is another picture of a head: its lights mixed and tinted, a background, a camera's
exposure, tone curve, blur, noise and JPEG (benchmarks/snapshots.py), the crop moved, and the
landmarks moved as a landmarker errs.
"""

# pyright: reportMissingImports=false, reportCallIssue=false

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import snapshots
from painted_fringe import painted_fringe
from skin_looks import skin_looks

from unlit.perception.parser import CLASSES, OTHERS, SIZE, contours
from unlit.photo.crop import face_crop

#: One head of so many is for the test.
HELD_OUT = 40


class Heads(torch.utils.data.IterableDataset[Any]):
    """Endless examples, input (9, S, S) and shares (13, S, S), float32, of the heads of a folder.

    S is parser.SIZE. Those whose number divides by HELD_OUT are kept for the test. Heads that are
    rendered meanwhile are taken up as they come.
    """

    def __init__(self, folder: Path, seed: int, test: bool = False) -> None:
        self.folder, self.seed, self.test = folder, seed, test

    def files(self) -> list[Path]:
        found = sorted(self.folder.glob("[0-9]*[0-9].npz"))
        return [file for file in found if (int(file.stem) % HELD_OUT == 0) == self.test]

    def __iter__(self) -> Any:
        rng = np.random.default_rng(self.seed)
        held: dict[Path, Any] = {}
        for number in itertools.count():
            if number % 1000 == 0:
                files = self.files()
            file = files[rng.integers(len(files))]
            if file not in held:
                with np.load(file) as data:
                    held[file] = tuple(data[name] for name in ("renders", "shares", "landmarks"))
            yield example(*held[file], rng)


def example(
    renders: np.ndarray, shares: np.ndarray, landmarks: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """One picture of a head."""
    size = renders.shape[1]
    hard = rng.random() < 0.3
    mix = rng.dirichlet(np.full(len(renders), 0.05 if hard else 0.6))
    tint = np.exp(rng.normal(0, 0.12, (len(renders), 3)))
    lit = renders[..., :3].astype(np.float32)
    level = lit.mean(axis=(1, 2, 3), keepdims=True) + 1e-6
    linear = np.einsum("l,lyxc,lc->yxc", mix, lit / level, tint)
    if rng.random() < 0.2:
        linear, shares = painted_fringe(linear, shares, landmarks[:, :2], rng)
    skin = shares[..., 1:3].sum(axis=-1, keepdims=True, dtype=np.float32) / 255
    if rng.random() < 0.5:
        linear = _smooth_hair(linear, shares, rng)
    paint, shine = skin_looks(landmarks[:, :2], size, rng)
    linear = linear * np.exp(skin * paint)
    # Where there is no light there is no shine.
    linear = linear + skin * shine * cv2.blur(linear, (9, 9)).mean(axis=-1, keepdims=True) * 3
    if hard or rng.random() < 0.5:  # the path tracer's noise must not tell hair from skin
        linear = cv2.bilateralFilter(linear.astype(np.float32), 5, 0.3, 1.2)
    behind = snapshots.background(size, rng).astype(np.float32)
    if hard:
        linear = _crushed(linear, skin > 0.9, rng)
        behind = behind * np.float32(rng.choice([0.0, 0.05, 1.0]))
    render = np.concatenate([linear, renders[0, ..., 3:]], axis=-1).astype(np.float32)
    picture = snapshots.developed(render, behind, rng)
    return _cropped(picture, shares, landmarks[:, :2], rng)


def _crushed(linear: np.ndarray, skin: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Light from one side only: what lies in shadow is black, up to a third of the skin."""
    if not skin.any():
        return linear
    grey = linear.mean(axis=-1, keepdims=True)
    black = np.quantile(grey[skin], rng.uniform(0.0, 0.35))
    return linear * np.maximum(1 - black / np.maximum(grey, 1e-6), rng.choice([0, 0.003, 0.02]))


def _smooth_hair(linear: np.ndarray, shares: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Well-kept hair: without the glitter of single strands, now and then of the skin's colour."""
    hair = shares[..., CLASSES.index("hair"), None].astype(np.float32) / 255
    linear = linear.astype(np.float32)
    sigma = rng.uniform(0.8, 3.0)
    weight = cv2.GaussianBlur(hair, (0, 0), sigma)[..., None] + 1e-3
    smooth = cv2.GaussianBlur(linear * hair, (0, 0), sigma) / weight
    skin = shares[..., 1] > 200
    if rng.random() < 0.4 and skin.any():
        near = linear[skin].mean(axis=0) / max(float(linear[skin].mean()), 1e-6)
        own = smooth.mean(axis=-1, keepdims=True)
        smooth = smooth + rng.uniform(0, 1) * (own * near - smooth)
    return linear + hair * rng.uniform(0.5, 1.0) * (smooth - linear)


def _cropped(
    picture: np.ndarray, shares: np.ndarray, landmarks: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The face's crop of it, a little off, and turned; the landmarks off, too."""
    height, width = picture.shape[:2]
    crop = face_crop(landmarks, SIZE, (width, height))
    side = SIZE / crop.scale * np.exp(rng.normal(0, 0.07))
    centre = crop.inverse_points((SIZE / 2, SIZE / 2)) + rng.normal(0, 0.03, 2) * side
    angle = np.radians(rng.normal(0, 5.0))
    scale = SIZE / side
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    move = np.array([SIZE / 2, SIZE / 2]) - turn @ centre
    matrix = np.column_stack([turn, move + turn @ (0.5, 0.5) - 0.5])

    def warped(image: np.ndarray, border: int) -> np.ndarray:
        return cv2.warpAffine(
            image, matrix, (SIZE, SIZE), flags=cv2.INTER_LINEAR, borderMode=border
        )

    image = warped(picture, cv2.BORDER_REPLICATE).astype(np.float32) / 255
    valid = warped(np.ones(picture.shape[:2], np.float32), cv2.BORDER_CONSTANT)
    # OpenCV takes four channels at once.
    parts = [shares[..., k : k + 4] for k in range(0, shares.shape[-1], 4)]
    parts = [warped(np.ascontiguousarray(part), cv2.BORDER_CONSTANT) for part in parts]
    planes = np.dstack(parts).transpose(2, 0, 1)
    target = planes.astype(np.float32) / 255
    target[0] += np.maximum(1 - target[OTHERS].sum(axis=0), 0)
    seen = landmarks @ turn.T + move
    drawn = contours(_mistaken(seen, rng), SIZE)
    if rng.random() < 0.06:  # grey photos
        image = np.repeat(image.mean(axis=-1, keepdims=True), 3, axis=-1)
    inputs = np.concatenate([image.transpose(2, 0, 1) - 0.5, valid[None], drawn])
    if rng.random() < 0.5:
        inputs, target = inputs[..., ::-1], target[..., ::-1]
    return np.ascontiguousarray(inputs), np.ascontiguousarray(target)


def _mistaken(landmarks: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Landmarks with errors that neighbours share, some 2 % of the face's size."""
    middle = landmarks.mean(axis=0)
    size = np.linalg.norm(landmarks.max(axis=0) - landmarks.min(axis=0))
    offset = landmarks - middle
    linear = np.eye(2) + rng.normal(0, 0.012, (2, 2))
    waves = rng.normal(0, 3.0 / size, (4, 2))
    phase = rng.uniform(0, 2 * np.pi, 4)
    bend = np.cos(offset @ waves.T + phase) @ rng.normal(0, 0.005 * size, (4, 2))
    return middle + offset @ linear.T + bend + rng.normal(0, 0.006 * size, 2)
