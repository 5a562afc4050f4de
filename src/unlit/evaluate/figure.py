"""Captioned sheets of pictures: the subject as it was read, and an evaluation's results."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..color import encode_srgb
from ..output.images import bytes_of, encoded, normals
from .protocol import Shot, ShotResult
from .truth import KnownSubject

_TILE = 256
_CAPTION = 22
_GAP = 6
_PAPER = (24, 24, 24)
_INK = (225, 225, 225)

#: A caption and a picture (H, W) or (H, W, 3), uint8.
Tile = tuple[str, np.ndarray]


def sheet(rows: list[list[Tile]]) -> np.ndarray:
    """(H, W, 3) uint8: the tiles row by row, each reduced to one size under its caption."""
    width = max(map(len, rows)) * (_TILE + _GAP) + _GAP
    height = len(rows) * (_TILE + _CAPTION + _GAP) + _GAP
    paper = Image.new("RGB", (width, height), _PAPER)
    draw = ImageDraw.Draw(paper)
    font = ImageFont.load_default(13)
    for i, row in enumerate(rows):
        for j, (caption, picture) in enumerate(row):
            x, y = _GAP + j * (_TILE + _GAP), _GAP + i * (_TILE + _CAPTION + _GAP)
            draw.text((x, y + 3), caption, fill=_INK, font=font)
            tile = (
                Image.fromarray(picture).convert("RGB").resize((_TILE, _TILE), Image.Resampling.BOX)
            )
            paper.paste(tile, (x, y + _CAPTION))
    return np.asarray(paper)


def check_sheet(subject: KnownSubject, shots: tuple[Shot, ...]) -> np.ndarray:
    """The subject under each light, and its maps: a wrong v axis or normal map is seen at once."""
    truth = subject.truth
    specular = bytes_of(truth.specular_albedo / 2)
    return sheet(
        [
            [(shot.light.name, encoded(shot.image)) for shot in shots],
            [
                ("diffuse albedo", encoded(truth.diffuse_albedo)),
                ("specular albedo, 0 to 2", specular),
                ("normals: red right, green up", normals(truth.normal)),
            ],
        ]
    )


def result_sheet(subject: KnownSubject, rows: list[ShotResult]) -> np.ndarray:
    """One line per reconstruction, as in the paper's Figure 5: photo, relit faces, maps."""
    truth = subject.truth
    lines: list[list[Tile]] = []
    for row in rows:
        inside = row.mask[..., None]
        title = row.light if row.variant == "full" else f"{row.light}, {row.variant}"
        line: list[Tile] = [(f"input: {title}", encoded(row.photo))]
        for relit in row.relit:
            ours = relit.image * relit.metrics["gain"]
            difference = np.abs(encode_srgb(ours) - encode_srgb(relit.truth))
            line += [
                (f"{relit.light}: relit", encoded(ours * inside)),
                ("truth", encoded(relit.truth * inside)),
                ("4 x error", bytes_of(4 * difference * inside)),
            ]
        albedo = row.face.face.maps.diffuse_albedo * row.maps["albedo_gain"]
        line += [
            ("diffuse albedo", encoded(albedo * inside)),
            ("truth", encoded(truth.diffuse_albedo * inside)),
            ("normals", normals(row.face.face.normals.specular * inside)),
            ("truth", normals(truth.normal * inside)),
        ]
        lines.append(line)
    return sheet(lines)
