"""The parser's network in torch, and its .onnx file."""

# pyright: reportMissingImports=false, reportCallIssue=false

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import nn
from torch.nn import functional

from unlit.perception.parser import CLASSES, CONTOURS, SIZE

#: Channels of each level, and residual blocks of all but the first.
CHANNELS = (24, 48, 64, 96, 128)
BLOCKS = (1, 2, 2, 2)


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


def take(model: Parser, file: Path, sample: torch.Tensor) -> None:
    """Give the model the weights of an .onnx file that this script wrote.

    There the normalisations are part of the convolutions. Each is made anew as what changes
    nothing of what its convolution says of `sample`, so that training can go on.
    """
    graph = onnx.load(str(file)).graph
    stored = {t.name: torch.tensor(onnx.numpy_helper.to_array(t)) for t in graph.initializer}
    for node in graph.node:  # of weights that are alike only one is stored
        if node.op_type == "Identity":
            stored[node.output[0]] = stored[node.input[0]]
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    nodes = iter([node for node in convolutions if len(node.input) == 3])  # without the tent
    folded: list[torch.Tensor] = []

    def convolution(module: nn.Conv2d, _: Any) -> None:
        _, weight, bias = next(nodes).input
        module.weight.copy_(stored[weight])
        if module.bias is None:
            folded.append(stored[bias])
        else:
            module.bias.copy_(stored[bias])

    def normalisation(module: nn.BatchNorm2d, inputs: Any) -> None:
        mean, variance = inputs[0].mean(dim=(0, 2, 3)), inputs[0].var(dim=(0, 2, 3))
        module.running_mean.copy_(mean)
        module.running_var.copy_(variance)
        module.weight.copy_(torch.sqrt(variance + module.eps))
        module.bias.copy_(mean + folded.pop())

    hooks = []
    for module in model.modules():
        if isinstance(module, nn.Conv2d):
            hooks.append(module.register_forward_pre_hook(convolution))
        if isinstance(module, nn.BatchNorm2d):
            hooks.append(module.register_forward_pre_hook(normalisation))
    model.eval()
    with torch.no_grad():
        model(sample)
    for hook in hooks:
        hook.remove()


def write(model: Parser, file: Path) -> None:
    """The weights as .onnx, which is written whole or not at all."""
    model.eval()
    part = file.with_suffix(".part")
    nothing = torch.zeros(1, 4 + len(CONTOURS), SIZE, SIZE)
    names = {"input_names": ["crop"], "output_names": ["logits"]}
    torch.onnx.export(model, (nothing,), str(part), dynamo=False, **names)
    part.replace(file)
