"""Train the network that tells skin from hair, glass and cloth, on path-traced heads only.

    python tools/parser_heads.py heads            # renders them, hours
    python tools/train_parser.py heads parser.onnx [--start known.onnx]

Needs torch and onnx, which unlit itself does not.
"""

# pyright: reportMissingImports=false

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path

import numpy as np
import torch
from parser_examples import Heads
from parser_network import Parser, take, write
from torch.nn import functional

from unlit.perception.parser import LENS, OTHERS

#: How much a pixel of each of OTHERS counts.
WEIGHTS = (1.0, 1.0, 2.0, 3.0, 1.5, 2.0, 1.0, 1.3, 2.0, 2.0, 1.2, 1.5)


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
    parser.add_argument("output", type=Path, help="an .onnx file")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0, help="of the examples")
    parser.add_argument("--start", type=Path, help="an .onnx file to go on from")
    parser.add_argument(
        "--keep", type=float, default=0.0, help="share of the weights of --start in the result"
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=3e-3,
        help="the highest learning rate; a tenth of it to go on from --start",
    )
    options = parser.parse_args()
    torch.manual_seed(0)
    heads = Heads(options.heads, options.seed)
    model = Parser().to(memory_format=torch.channels_last)
    print(
        f"{len(heads.files())} heads, {sum(p.numel() for p in model.parameters())} weights",
        flush=True,
    )
    tests = zip(*itertools.islice(Heads(options.heads, 1, test=True), 96), strict=True)
    test_in, test_out = (torch.from_numpy(np.stack(x)) for x in tests)
    began_with: dict[str, torch.Tensor] = {}
    if options.start:
        take(model, options.start, test_in)
        began_with = {name: value.clone() for name, value in model.state_dict().items()}
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
            write(model, options.output)
    # What was learnt last is not to push out what was known.
    for name, value in model.state_dict().items():
        if name in began_with and value.is_floating_point():
            value.lerp_(began_with[name], options.keep)
    write(model, options.output)


if __name__ == "__main__":
    main()
