"""Texture of the person's own skin for where the photo shows none.

Skin without its pores and blotches looks like plastic. Where it was not measured it gets texture
with the statistics of measured patches of the same face: random-phase noise (Galerne, Gousseau
and Morel 2011), one random phase for all channels of a patch, so that a pore is dark, rough and
bent at the same place. Nothing but this photo goes into it. The noise is periodic and lies in
space, on three planes (triplanar mapping), so that the layout's seams and stretch do not show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

#: Side of a patch and of the noise's period, cm; patches at most, of so many that are looked at.
_PATCH, _PERIOD, _PATCHES, _LOOKED_AT = 1.5, 12.0, 6, 16
#: Standard deviation of the blur that tells texture from tone, cm.
_TONE = 0.15
#: Share of a patch that has to be good evidence.
_GOOD = 0.97
_SEED = 20
_FINER = 2  # samples of the noise for each pixel of the crop, so that look-ups need no filter


@dataclass(frozen=True)
class SkinTexture:
    """levels: (T, T, C) noise, then the same averaged over 2 x 2 samples, and so on.

    step: cm from one sample of the first to the next.
    """

    levels: tuple[np.ndarray, ...]
    step: float

    def at(self, point: np.ndarray, normal: np.ndarray, footprint: np.ndarray) -> np.ndarray:
        """Noise (K, C) at points (K, 3), cm, of surfaces with unit normals (K, 3).

        footprint: (K,) cm, the side of what each value stands for.
        """
        out = np.empty((len(point), self.levels[0].shape[2]), dtype=np.float32)
        finest = np.log2(np.maximum(footprint / self.step, 1))
        level = np.minimum(np.rint(finest).astype(int), len(self.levels) - 1)
        steep = np.abs(normal) ** 6
        order = np.argsort(steep, axis=1)[:, ::-1]
        for number, noise in enumerate(self.levels):
            rows = np.flatnonzero(level == number)
            if not rows.size:
                continue
            cell = np.floor(point[rows] / (self.step * 2**number)).astype(np.int64) % len(noise)
            flat = noise.reshape(-1, noise.shape[2])
            total, squares = 0.0, 0.0
            for plane in (0, 1):
                axis = order[rows, plane]
                weight = np.take_along_axis(steep[rows], axis[:, None], axis=1)
                a = np.take_along_axis(cell, (axis[:, None] + 1) % 3, axis=1)[:, 0]
                b = np.take_along_axis(cell, (axis[:, None] + 2) % 3, axis=1)[:, 0]
                # Planes are moved against each other, so that edges between them do not mirror.
                place = (a + 37 * axis) % len(noise) * len(noise) + b
                total = total + weight * flat[place]
                squares = squares + weight**2
            # Independent values, so that their variance stays: not their sum is 1.
            out[rows] = total / np.sqrt(np.maximum(squares, 1e-12))
        return out


def skin_texture(
    channels: np.ndarray, evidence: np.ndarray, centimetre: float
) -> SkinTexture | None:
    """The texture of `channels` (S, S, C) where `evidence` (S, S) is 1; None without a patch.

    centimetre: its length on the face, pixels. Deterministic.
    """
    side = max(round(_PATCH * centimetre), 8)
    corners = _patches(evidence, side)
    if not corners:
        return None
    period = 1 << int(np.ceil(np.log2(_PERIOD * centimetre)))
    weight = evidence[..., None]
    share = ndimage.gaussian_filter(evidence, _TONE * centimetre)[..., None]
    rng = np.random.default_rng(_SEED)
    window = np.outer(np.hanning(side + 2)[1:-1], np.hanning(side + 2)[1:-1]).astype(np.float32)
    gain = period / np.sqrt((window**2).sum())
    spectrum = np.zeros((period, period // 2 + 1, channels.shape[2]), dtype=np.complex64)
    blur = (_TONE * centimetre, _TONE * centimetre, 0)
    tone = ndimage.gaussian_filter(channels * weight, blur) / np.maximum(share, 1e-6)
    patches = [
        channels[here] - tone[here]
        for here in ((slice(a, a + side), slice(b, b + side)) for a, b in corners)
    ]
    # The calmest: wrinkles, stubble, moles and edges of make-up belong where they are.
    patches = sorted(patches, key=lambda patch: float(patch[..., :3].var()))[:_PATCHES]
    for number, patch in enumerate(patches):
        # Turned, so that on the whole no direction stands out.
        patch = np.rot90(patch, number) * window[..., None]
        phase = np.fft.rfft2(rng.standard_normal((period, period)))
        phase /= np.maximum(np.abs(phase), 1e-12)
        found = np.fft.rfft2(patch, (period, period), axes=(0, 1))
        spectrum += (gain / np.sqrt(len(patches))) * found * phase[..., None]
    spectrum[0, 0] = 0
    fine = _FINER * period
    # More samples of the same waves; the wave at the limit of the pixels is left out.
    wide = np.zeros((fine, fine // 2 + 1, channels.shape[2]), dtype=np.complex64)
    half = period // 2
    wide[:half, :half], wide[-half + 1 :, :half] = (
        spectrum[:half, :half],
        spectrum[-half + 1 :, :half],
    )
    noise = np.fft.irfft2(wide, (fine, fine), axes=(0, 1)).astype(np.float32) * _FINER**2
    levels = [noise]
    while len(levels[-1]) > 8:
        last = levels[-1]
        levels.append(last.reshape(len(last) // 2, 2, len(last) // 2, 2, -1).mean(axis=(1, 3)))
    return SkinTexture(tuple(levels), 1 / (centimetre * _FINER))


def _patches(evidence: np.ndarray, side: int) -> list[tuple[int, int]]:
    """First row and column of squares of good evidence that do not overlap."""
    sure = ndimage.uniform_filter((evidence > 0.99).astype(np.float32), side, mode="constant")
    # The filter's value is that of the window that starts side // 2 before.
    found: list[tuple[int, int]] = []
    half = side // 2
    free = sure.copy()
    while len(found) < _LOOKED_AT and free.max() >= _GOOD:
        row, column = np.unravel_index(int(free.argmax()), free.shape)
        top, left = int(row) - half, int(column) - half
        if top >= 0 and left >= 0 and top + side <= len(free) and left + side <= free.shape[1]:
            found.append((top, left))
        free[max(row - side, 0) : row + side, max(column - side, 0) : column + side] = 0
    return found
