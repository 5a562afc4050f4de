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
from painted_fringe import painted_fringe
from skin_looks import skin_looks

from unlit.perception.parser import CLASSES, CONTOURS, LENS, OTHERS, SIZE, contours
from unlit.photo.crop import face_crop

#: How much a pixel of each of OTHERS counts.
WEIGHTS = (1.0, 1.0, 2.0, 3.0, 1.5, 2.0, 1.0, 1.3, 2.0, 2.0, 1.2, 1.5)
#: One head of so many is for the test.
HELD_OUT = 40
#: Channels of each level, and residual blocks of all but the first.
CHANNELS = (24, 48, 64, 96, 128)
BLOCKS = (1, 2, 2, 2)


class Heads(torch.utils.data.IterableDataset[Any]):
    """Endless examples, input (9, S, S) and shares (13, S, S), float32, of the heads of a folder.

    Those whose number divides by HELD_OUT are kept for the test. Heads that are rendered meanwhile
    are taken up as they come.
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
    planes = [warped(shares[..., k], cv2.BORDER_CONSTANT) for k in range(shares.shape[-1])]
    target = np.stack(planes).astype(np.float32) / 255
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


class Parser(nn.Module):
    """A residual U-Net of 1.5 million weights; a pixel of its finest level is 2 x 2 of the crop."""

    def __init__(self) -> None:
        super().__init__()
        pairs = list(itertools.pairwise(CHANNELS))
        self.stem = _layer(4 * (4 + len(CONTOURS)), CHANNELS[0])
        self.down = nn.ModuleList([_layer(a, b, stride=2) for a, b in pairs])
        self.blocks = nn.ModuleList(
            [
                nn.Sequential(*(_Residual(c) for _ in range(n)))
                for (_, c), n in zip(pairs, BLOCKS, strict=True)
            ]
        )
        self.everywhere = _Everywhere(CHANNELS[-1])
        self.aside = nn.ModuleList([nn.Conv2d(b, a, 1) for a, b in pairs])
        self.up = nn.ModuleList([_layer(a, a) for a, _ in pairs])
        self.last = nn.Conv2d(CHANNELS[0], 4 * len(CLASSES), 1)
        # The four pixels of a cell are made alone; neighbours' borders must not show.
        tent = torch.tensor([1.0, 2.0, 1.0]) / 4
        kernel = (tent[:, None] * tent).expand(len(CLASSES), 1, 3, 3).clone()
        self.register_buffer("tent", kernel, persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = self.stem(functional.pixel_unshuffle(x, 2))
        kept = []
        for down, block in zip(self.down, self.blocks, strict=True):
            kept.append(y)
            y = block(down(y))
        y = self.everywhere(y)
        for aside, up, side in zip(self.aside[::-1], self.up[::-1], kept[::-1], strict=True):
            y = up(functional.interpolate(aside(y), scale_factor=2.0) + side)
        fine = functional.pixel_shuffle(self.last(y), 2)
        return functional.conv2d(fine, self.tent, padding=1, groups=len(CLASSES))


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _layer(width, width)
        self.second = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.norm = nn.BatchNorm2d(width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return functional.relu(x + self.norm(self.second(self.first(x))))


class _Everywhere(nn.Module):
    """Adds what the whole picture says, so that glasses or a beard are judged as a whole."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.mix = nn.Sequential(nn.Conv2d(width, width, 1), nn.ReLU(), nn.Conv2d(width, width, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + functional.interpolate(self.mix(x.mean(dim=(2, 3), keepdim=True)), x.shape[2:])


def _layer(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


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
    """Train, test on the heads held out, write the weights."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("heads", type=Path)
    parser.add_argument("output", type=Path, help="an .onnx file; its weights beside it as .pt")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0, help="of the examples")
    parser.add_argument("--start", type=Path, help="weights (.pt) to go on from")
    parser.add_argument(
        "--keep", type=float, default=0.0, help="share of the weights of --start in the result"
    )
    parser.add_argument("--rate", type=float, default=3e-3, help="the highest learning rate")
    options = parser.parse_args()
    torch.manual_seed(0)
    heads = Heads(options.heads, options.seed)
    model = Parser().to(memory_format=torch.channels_last)
    print(
        f"{len(heads.files())} heads, {sum(p.numel() for p in model.parameters())} weights",
        flush=True,
    )
    began_with = torch.load(options.start, weights_only=True) if options.start else {}
    if began_with:
        model.load_state_dict(began_with)
    tests = zip(*itertools.islice(Heads(options.heads, 1, test=True), 96), strict=True)
    test_in, test_out = (torch.from_numpy(np.stack(x)) for x in tests)
    loader = torch.utils.data.DataLoader(
        heads, batch_size=options.batch, num_workers=1, prefetch_factor=4
    )
    peak = options.rate
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
    # What was learnt last is not to push out what was known.
    learnt = model.state_dict()
    for name, known in began_with.items():
        if known.is_floating_point():
            learnt[name].lerp_(known, options.keep)
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
