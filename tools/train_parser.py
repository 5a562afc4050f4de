"""Train the network that tells skin from hair, glass and cloth, on path-traced heads only.

    python tools/parser_heads.py heads            # renders them, hours
    python tools/train_parser.py heads parser.onnx [--minutes 60]

Needs torch and onnx, which unlit itself does not. Every example is another picture of a head: its
lights mixed and tinted, a background, a camera's exposure, tone curve, blur, noise and JPEG
(benchmarks/snapshots.py), the crop moved, and the landmarks moved as a landmarker errs. The network
sees the crop's encoded colour, which pixels are in the photo, and the landmarks' contours drawn.
"""

# pyright: reportMissingImports=false, reportCallIssue=false

from __future__ import annotations

import argparse
import itertools
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import nn
from torch.nn import functional

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import snapshots
from classes import CLASSES, LENS, OTHERS

from unlit.perception.topology import (
    FACE_OVAL,
    LEFT_EYE,
    LEFT_EYEBROW,
    LIPS_INNER,
    LIPS_OUTER,
    RIGHT_EYE,
    RIGHT_EYEBROW,
)
from unlit.photo.crop import face_crop

SIZE = 192
#: What of the landmarks the network is told, each contour filled in a channel of its own.
CONTOURS = (
    (FACE_OVAL,),
    (RIGHT_EYE, LEFT_EYE),
    (RIGHT_EYEBROW, LEFT_EYEBROW),
    (LIPS_OUTER,),
    (LIPS_INNER,),
)

#: How much a pixel of each of OTHERS counts.
WEIGHTS = (1.0, 1.0, 2.0, 3.0, 1.5, 2.0, 1.0, 1.3, 2.0, 2.0, 1.2, 1.5)
CHANNELS = (24, 32, 48, 64, 96)


def drawn(landmarks: np.ndarray, size: int) -> np.ndarray:
    """(5, size, size) float32 in [0, 1]: CONTOURS, filled; landmarks: (478, 2), pixels."""
    result = np.zeros((len(CONTOURS), size, size), np.float32)
    for channel, contours in zip(result, CONTOURS, strict=True):
        for contour in contours:
            points = np.round(landmarks[list(contour)] * 16 - 8).astype(np.int32)
            cv2.fillPoly(channel, [points], 1.0, lineType=cv2.LINE_AA, shift=4)
    return result


class Heads(torch.utils.data.IterableDataset[Any]):
    """Endless examples: input (9, S, S) and shares (C, S, S), float32."""

    def __init__(self, files: list[Path], seed: int) -> None:
        self.files, self.seed = files, seed

    def __iter__(self) -> Any:
        worker = torch.utils.data.get_worker_info()
        rng = np.random.default_rng([self.seed, worker.id if worker else 0])
        held: dict[Path, Any] = {}
        while True:
            file = self.files[rng.integers(len(self.files))]
            if file not in held:
                with np.load(file) as data:
                    held[file] = tuple(data[name] for name in ("renders", "shares", "landmarks"))
            yield example(*held[file], rng)


def example(
    renders: np.ndarray, shares: np.ndarray, landmarks: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """One picture of a head."""
    size = renders.shape[1]
    mix = rng.dirichlet(np.full(len(renders), 0.6))
    tint = np.exp(rng.normal(0, 0.12, (len(renders), 3)))
    lit = renders[..., :3].astype(np.float32)
    level = lit.mean(axis=(1, 2, 3), keepdims=True) + 1e-6
    linear = np.einsum("l,lyxc,lc->yxc", mix, lit / level, tint)
    skin = shares[..., 1:3].sum(axis=-1, keepdims=True, dtype=np.float32) / 255
    linear = linear * np.exp(skin * _detail(size, rng))
    if rng.random() < 0.5:  # the path tracer's noise must not tell hair from skin
        linear = cv2.bilateralFilter(linear.astype(np.float32), 5, 0.3, 1.2)
    render = np.concatenate([linear, renders[0, ..., 3:]], axis=-1).astype(np.float32)
    behind = snapshots.background(size, rng).astype(np.float32)
    picture = snapshots.developed(render, behind, rng)
    return _cropped(picture, shares, landmarks[:, :2], rng)


def _detail(size: int, rng: np.random.Generator) -> np.ndarray:
    """(S, S, 3): log albedo of freckles, redness and pores, and now and then a mole."""
    total = np.zeros((size, size, 3), np.float32)
    for sigma in (0.7, 1.5, 4.0, 12.0):
        noise = cv2.GaussianBlur(
            rng.standard_normal((size, size)).astype(np.float32), (0, 0), sigma
        )
        strength = abs(rng.normal(0, 0.05)) / max(float(noise.std()), 1e-6)
        total += (strength * noise)[..., None] * np.array([0.6, 1.0, 1.0]) * rng.uniform(0.5, 1)
    for _ in range(rng.integers(0, 6)):
        x, y = (int(v) for v in rng.uniform(0.3, 0.7, 2) * size)
        spot = np.zeros((size, size), np.float32)
        cv2.circle(spot, (x, y), int(rng.integers(1, 3)), 1.0, -1, cv2.LINE_AA)
        total -= spot[..., None] * rng.uniform(0.2, 0.9)
    return total


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
    planes = [warped(shares[..., k], cv2.BORDER_CONSTANT) for k in range(shares.shape[-1])]
    target = np.stack(planes).astype(np.float32) / 255
    target[0] += np.maximum(1 - target[OTHERS].sum(axis=0), 0)
    seen = landmarks @ turn.T + move
    contours = drawn(_mistaken(seen, rng), SIZE)
    if rng.random() < 0.06:  # grey photos
        image = np.repeat(image.mean(axis=-1, keepdims=True), 3, axis=-1)
    inputs = np.concatenate([image.transpose(2, 0, 1) - 0.5, valid[None], contours])
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


class Parser(nn.Module):
    """A U-Net of a few hundred thousand weights, at half the resolution but for its last layer."""

    def __init__(self) -> None:
        super().__init__()
        inputs, outputs = 4 + len(CONTOURS), len(CLASSES)
        widths = (inputs, *CHANNELS)
        pairs = list(itertools.pairwise(widths))
        self.down = nn.ModuleList([_block(a, b, stride=2) for a, b in pairs])
        self.middle = nn.Sequential(_block(CHANNELS[-1], CHANNELS[-1]), _Everywhere(CHANNELS[-1]))
        steps = list(itertools.pairwise(CHANNELS[::-1]))
        self.up = nn.ModuleList([_block(a + b, b) for a, b in steps])
        self.fine = nn.Conv2d(inputs, 12, 3, padding=1)
        self.last = nn.Sequential(
            nn.Conv2d(12 + CHANNELS[0], 16, 1),
            nn.ReLU(),
            nn.Conv2d(16, 16, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(16, outputs, 1),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        kept, y = [], x
        for down in self.down:
            y = down(y)
            kept.append(y)
        y = self.middle(y)
        for up, side in zip(self.up, kept[-2::-1], strict=True):
            y = up(torch.cat([_twice(y), side], dim=1))
        return self.last(torch.cat([_twice(y), functional.relu(self.fine(x))], dim=1))


class _Everywhere(nn.Module):
    """Adds what the whole picture says, so that glasses or a beard are judged as a whole."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.mix = nn.Sequential(nn.Conv2d(width, width, 1), nn.ReLU(), nn.Conv2d(width, width, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.mix(x.mean(dim=(2, 3), keepdim=True))


def _block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
        nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    )


def _twice(x: torch.Tensor) -> torch.Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def loss_of(logits: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Cross-entropy with the shares, and that of the lens."""
    weights = torch.tensor(WEIGHTS)[None, :, None, None]
    log = functional.log_softmax(logits[:, OTHERS], dim=1)
    classes = -(weights * target[:, OTHERS] * log).sum(dim=1).mean()
    lens = functional.binary_cross_entropy_with_logits(logits[:, LENS], target[:, LENS].clamp(0, 1))
    return classes + lens


def skin_iou(logits: torch.Tensor, target: torch.Tensor) -> float:
    """Of skin with brows at one half, over all examples."""
    shares = torch.zeros_like(target)
    shares[:, OTHERS] = functional.softmax(logits[:, OTHERS], dim=1)
    found, true = (s[:, 1] + s[:, 4] > 0.5 for s in (shares, target))
    return float((found & true).sum() / (found | true).sum())


def main() -> None:
    """Train, test on every fortieth head, write the weights."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("heads", type=Path)
    parser.add_argument("output", type=Path, help="an .onnx file; its weights beside it as .pt")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--batch", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0, help="of the examples")
    parser.add_argument("--start", type=Path, help="weights (.pt) to go on from")
    options = parser.parse_args()
    torch.manual_seed(0)
    files = sorted(options.heads.glob("[0-9]*[0-9].npz"))
    held_out, files = files[::40], [f for k, f in enumerate(files) if k % 40]
    model = Parser().to(memory_format=torch.channels_last)
    print(f"{len(files)} heads, {sum(p.numel() for p in model.parameters())} weights", flush=True)
    if options.start:
        model.load_state_dict(torch.load(options.start, weights_only=True))
    tests = zip(*itertools.islice(Heads(held_out, 1), 60), strict=True)
    test_in, test_out = (torch.from_numpy(np.stack(x)) for x in tests)
    loader = torch.utils.data.DataLoader(
        Heads(files, options.seed), batch_size=options.batch, num_workers=1, prefetch_factor=4
    )
    peak = 3e-3
    optimiser = torch.optim.AdamW(model.parameters(), lr=peak, weight_decay=1e-3)
    began, seconds, shown, total = time.monotonic(), 60 * options.minutes, 0.0, []
    for number, (inputs, target) in enumerate(loader):
        share = (time.monotonic() - began) / seconds
        if share >= 1:
            break
        for group in optimiser.param_groups:
            group["lr"] = peak * min(1, 20 * share + 0.02) * 0.5 * (1 + np.cos(np.pi * share))
        model.train()
        loss = loss_of(model(inputs), target)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        total.append(loss.item())
        if time.monotonic() - shown > 60:
            shown = time.monotonic()
            model.eval()
            with torch.no_grad():
                logits = torch.cat([model(part) for part in test_in.split(12)])
                tested, iou = loss_of(logits, test_out).item(), skin_iou(logits, test_out)
            text = f"{number * options.batch} examples, loss {np.mean(total):.4f}"
            print(f"{share:.2f}: {text}, held out {tested:.4f}, skin IoU {iou:.4f}", flush=True)
            total = []
            torch.save(model.state_dict(), options.output.with_suffix(".pt"))
    model.eval()
    torch.save(model.state_dict(), options.output.with_suffix(".pt"))
    torch.onnx.export(
        model,
        (torch.zeros(1, 4 + len(CONTOURS), SIZE, SIZE),),
        str(options.output),
        input_names=["crop"],
        output_names=["logits"],
        dynamo=False,
    )


if __name__ == "__main__":
    main()
